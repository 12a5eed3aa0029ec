"""`phrt report`: a benchmark's folder as one page that opens without a network."""
