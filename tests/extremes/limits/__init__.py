"""Laws that functions keep within a range, and what comes outside it: tests and a page of docs."""
