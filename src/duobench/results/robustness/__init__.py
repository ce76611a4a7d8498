"""Robustness: what runs under many shifts add up to, and the page that shows it."""
