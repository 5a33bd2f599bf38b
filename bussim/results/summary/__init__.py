"""``summary.json``: the numbers of a run, made once from what the meters kept."""

#: Version of ``summary.json`` and ``histograms.json``; rises when a key changes its meaning.
SCHEMA = 1
