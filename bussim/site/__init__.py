"""From what a programming tool shows of a link to causes, noise and a profile: ``bussim site``."""
