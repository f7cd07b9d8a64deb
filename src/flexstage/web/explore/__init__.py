"""The view Explore: forms, computations, tables and charts."""
