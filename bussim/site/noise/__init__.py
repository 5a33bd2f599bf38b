"""How much noise a link has, and where: each reading with what it tells."""
