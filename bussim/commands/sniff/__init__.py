"""``bussim sniff``."""
