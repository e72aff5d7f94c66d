"""``gtlayout annotate``: a page on this machine on which one person annotates a scene while it is solved again."""
