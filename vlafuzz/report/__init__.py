"""The report: a store or an exported corpus as one self-contained HTML page."""
