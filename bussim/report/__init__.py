"""Layer 6: what is looked at: the timeline of a bus, and the report on one run or several.

Knows the results and the trace, not who made them; what comes from elsewhere (the exact distribution) is
handed in as plain data by ``bussim.commands``.
"""
