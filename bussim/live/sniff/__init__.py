"""What a line's listener makes of characters: frames, exchanges, link scans."""
