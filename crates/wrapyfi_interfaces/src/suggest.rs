//! "Did you mean": the known word nearest to a wrong one.

/// `did you mean ...? ` when one of `known` is near `word`, else nothing.
///
/// ```
/// assert_eq!(wrapyfi_interfaces::did_you_mean("imgae", &["image", "audio"]), "did you mean `image`? ");
/// assert_eq!(wrapyfi_interfaces::did_you_mean("video", &["image", "audio"]), "");
/// ```
pub fn did_you_mean<S: AsRef<str>>(word: &str, known: &[S]) -> String {
    known
        .iter()
        .map(|candidate| {
            (strsim::damerau_levenshtein(word, candidate.as_ref()), candidate.as_ref())
        })
        .filter(|&(distance, candidate)| distance <= 1 + candidate.len() / 4)
        .min()
        .map(|(_, candidate)| format!("did you mean `{candidate}`? "))
        .unwrap_or_default()
}
