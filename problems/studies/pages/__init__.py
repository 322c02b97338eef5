"""Pages of results, written from result files: every number stands in a file that a measuring command wrote."""
