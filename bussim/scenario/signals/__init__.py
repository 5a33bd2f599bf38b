"""What leads where: signals through programs and over the link."""
