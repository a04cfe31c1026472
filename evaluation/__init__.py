"""The benchmark: policies over suites of frozen seeds, statistics, and the report."""
