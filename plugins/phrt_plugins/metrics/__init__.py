"""The built-in metrics: what pictures, frame times and decisions are judged by. docs/metrics.md has every column."""
