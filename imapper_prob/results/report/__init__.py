"""``report.html``: the result for people who will not open Python."""
