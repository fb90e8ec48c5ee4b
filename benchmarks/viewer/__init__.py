"""Window and page."""
