"""Tests of haptune."""
