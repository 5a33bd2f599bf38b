"""``bussim ui``: a line on a page of the browser, answered by a server on this computer alone."""
