"""From a draft without mistakes to frozen values, and back to the file's form."""
