"""The sampled loop: device under a zero-order hold, delay and filters, as polynomials in w."""
