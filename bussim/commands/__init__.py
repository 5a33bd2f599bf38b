"""One module or folder a command; each is imported only when it is used."""
