"""What a line shows whose frames nobody has published: their layout, and what silences and lengths tell."""
