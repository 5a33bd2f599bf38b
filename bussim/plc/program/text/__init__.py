"""An instruction list as text: read, checked, and cut where it jumps."""
