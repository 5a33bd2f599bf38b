"""``bussim exact``."""
