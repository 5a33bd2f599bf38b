"""``bussim fit``."""
