"""Who is who: people seen frame by frame, put together into actors."""
