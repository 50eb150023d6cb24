"""Made-up countryside: what lies on it (shapes), and its picture and heights (paint)."""
