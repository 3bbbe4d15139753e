"""Items on the belt: their edges, their tracking, the queue of edges."""
