"""Devices with a protocol of their own: a barcode reader, a scale, a display."""
