"""What all parts say and need: errors' pages, warnings, progress, scikit-learn."""
