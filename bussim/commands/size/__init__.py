"""``bussim size``."""
