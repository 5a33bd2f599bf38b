"""``bussim site``."""
