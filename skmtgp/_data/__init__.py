"""Data as users have them: columns, labels, partitions."""
