//! Errors of what is written, and "did you mean": the known word nearest to a wrong one.

use proc_macro2::Span;

/// The error that `advice` says, at `place`.
pub(crate) fn wrong<T>(place: Span, advice: impl std::fmt::Display) -> syn::Result<T> {
    Err(syn::Error::new(place, advice))
}

/// `did you mean ...? ` when one of `known` is near `word`, else nothing.
pub(crate) fn did_you_mean<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    known
        .into_iter()
        .map(|candidate| (strsim::damerau_levenshtein(word, candidate), candidate))
        .filter(|&(distance, candidate)| distance <= 1 + candidate.len() / 4)
        .min()
        .map(|(_, candidate)| format!("did you mean `{candidate}`? "))
        .unwrap_or_default()
}

/// `a`, `b` and `c`.
pub(crate) fn listed<'a>(words: impl IntoIterator<Item = &'a str>) -> String {
    words.into_iter().map(|word| format!("`{word}`")).collect::<Vec<_>>().join(", ")
}
