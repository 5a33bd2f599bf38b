"""What a line shows whose frames are not published: their layout, and what silences and lengths tell."""
