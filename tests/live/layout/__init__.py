"""Tests of layouts, and of what silences tell."""
