"""Checks of records before anything is fitted: faulty channels, clocks past the end."""
