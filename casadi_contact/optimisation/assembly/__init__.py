"""Bodies on joints or free, and what acts between them: contacts, ligaments, muscles, springs on coordinates."""
