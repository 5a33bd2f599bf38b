"""What several commands share: options, output files, progress, tables."""
