"""Tables for the terminal, charts and the report page, made from result files and surrogates only."""
