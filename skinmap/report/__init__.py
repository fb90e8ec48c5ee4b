"""Reports: pages, tables, figures and projections of results."""
