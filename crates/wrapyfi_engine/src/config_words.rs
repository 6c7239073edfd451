//! Values that are a word or a mapping.

use std::fmt;

use serde::de::{self, IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

/// Reads a value that is either a word of enum `W` or a mapping `M`, with errors that point into
/// the one that was written (an untagged enum would only say that nothing matched).
pub(super) fn word_or_map<'de, D, W, M, T>(
    deserializer: D,
    expected: &'static str,
    from_word: impl FnOnce(W) -> Result<T, String>,
    from_map: impl FnOnce(M) -> Result<T, String>,
) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    W: Deserialize<'de>,
    M: Deserialize<'de>,
{
    struct Either<W, M, F, G>(&'static str, F, G, std::marker::PhantomData<(W, M)>);

    impl<'de, W, M, T, F, G> Visitor<'de> for Either<W, M, F, G>
    where
        W: Deserialize<'de>,
        M: Deserialize<'de>,
        F: FnOnce(W) -> Result<T, String>,
        G: FnOnce(M) -> Result<T, String>,
    {
        type Value = T;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(self.0)
        }

        fn visit_str<Er: de::Error>(self, word: &str) -> Result<T, Er> {
            (self.1)(W::deserialize(word.into_deserializer())?).map_err(de::Error::custom)
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
            let read = M::deserialize(de::value::MapAccessDeserializer::new(map))?;
            (self.2)(read).map_err(de::Error::custom)
        }
    }

    deserializer.deserialize_any(Either(expected, from_word, from_map, std::marker::PhantomData))
}
