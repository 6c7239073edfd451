//! Wrapyfi over ZeroMQ: publish, listen and the broker.
