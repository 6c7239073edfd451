//! Routes: configuration, state, and the loop that moves messages.
