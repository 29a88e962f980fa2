"""What people look at: tables, figures, pages, JSON documents."""
