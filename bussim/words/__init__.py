"""What users read, in English and Chinese: sentences and labels by key, from the tables of this folder."""
