"""How much noise there is, and where: each reading with what it tells."""
