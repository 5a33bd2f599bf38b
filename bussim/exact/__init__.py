"""Layer 5: the link scan as a probability law, worked out instead of simulated, and sizing from it.

:mod:`bussim.exact.link` describes one N:N link in plain numbers, :mod:`bussim.exact.reading` takes
them from a scenario, :mod:`bussim.exact.figures` gives the figures of one setting,
:mod:`bussim.exact.grid` those of all settings, and :mod:`bussim.exact.sizing` chooses one.
"""
