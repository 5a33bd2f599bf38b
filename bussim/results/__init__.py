"""What a run leaves behind: statistics, summary, texts, pictures and files.

There is one way through it: records are counted by the ``meters``, the ``collector`` hands them on and has
the ``summary`` made once at the end, and ``text``, ``plots`` and ``store`` speak from the summary and the
meters' histograms. Nothing here knows whether a simulation or a recording wrote the records of
:mod:`bussim.trace.records`.
"""
