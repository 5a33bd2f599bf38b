"""A link scan under bursts: the channel's state, exchanges as matrices, the chain of scans."""
