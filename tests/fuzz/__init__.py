"""Readers of what others write, given mutated files: each reads on or says in words what is wrong."""
