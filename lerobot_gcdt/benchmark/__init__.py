"""Measurements of the policies."""
