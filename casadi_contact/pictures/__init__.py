"""Charts, pictures of contact, the report and the page in a browser."""
