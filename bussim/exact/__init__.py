"""The link scan as a probability distribution, worked out instead of simulated, and sizing from it.

:mod:`bussim.exact.link` describes one N:N link in plain numbers, :mod:`bussim.exact.from_scenario` takes
them from a scenario, :mod:`bussim.exact.metrics` gives the figures of one setting,
:mod:`bussim.exact.sizing.grid` those of all settings, and :mod:`bussim.exact.sizing.size` chooses one.
"""
