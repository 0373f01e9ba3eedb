"""Controllers in other languages and file formats: one module a format, and one law over all of them."""
