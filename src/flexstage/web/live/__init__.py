"""What is measured now, on a page: a history that many look at, and the chart that follows it."""
