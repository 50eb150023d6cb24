"""Synthetic countryside: its layout (shapes), and its picture and heights (paint)."""
