from skinmap.report.page import lines_page
from skinmap.report.result import Verdict, plain
from skinmap.report.table import Table

__all__ = ["Table", "Verdict", "lines_page", "plain"]
