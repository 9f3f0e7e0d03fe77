"""Stability of the loop: verdict, gain intervals and the largest effect, without iteration."""
