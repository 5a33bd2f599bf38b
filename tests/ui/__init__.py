"""The page of `bussim ui` and its server."""
