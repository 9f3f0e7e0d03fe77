"""The sampled loop: zero-order hold, delay and filters, in the w of the bilinear transform."""
