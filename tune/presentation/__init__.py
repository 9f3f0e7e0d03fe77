"""Results as pictures, and as one page to read, print and sign."""
