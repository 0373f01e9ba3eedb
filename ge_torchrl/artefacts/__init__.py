"""What a run leaves behind: records, and the folder that holds them."""
