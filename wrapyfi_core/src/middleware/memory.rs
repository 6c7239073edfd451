//! Topics inside one process: for unit tests, and to show how small a middleware can be.
