"""The timeline of a bus, and the report on one run or several.

Made from results and traces alone; exact distributions are handed in as plain data by ``bussim.commands``.
"""
