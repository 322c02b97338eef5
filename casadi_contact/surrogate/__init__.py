"""Networks as a contact model: structures, files, confidence."""
