"""``bussim poll``."""
