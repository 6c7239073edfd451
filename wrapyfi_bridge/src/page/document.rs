//! The page as one file, and the policy that lets it run its own script and no other.

use bytes::Bytes;
use sha2::{Digest as _, Sha256};

/// The page, and the value of its header `Content-Security-Policy`.
pub(super) struct Document {
    pub(super) html: Bytes,
    pub(super) policy: String,
}

impl Document {
    pub(super) fn new() -> Self {
        let (style, script) = (include_str!("page.css"), include_str!("page.js"));
        let html = include_str!("page.html");
        let html = html.replace("/*STYLE*/", style).replace("/*SCRIPT*/", script);
        let hash = |text: &str| base64_simd::STANDARD.encode_to_string(Sha256::digest(text));
        let policy = format!(
            "default-src 'none'; script-src 'sha256-{}'; style-src 'sha256-{}'; img-src data:; connect-src 'self'; \
             base-uri 'none'; form-action 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'",
            hash(script),
            hash(style)
        );
        Self { html: html.into(), policy }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_one_small_file_that_needs_nothing_from_anywhere() {
        let Document { html, policy } = Document::new();
        let text = std::str::from_utf8(&html).unwrap();
        assert!(html.len() < 200_000, "{} bytes", html.len());
        assert!(!text.contains("/*STYLE*/") && !text.contains("/*SCRIPT*/"));
        // Names of vocabularies are no addresses.
        let rest = text.replace("http://www.w3.org/2000/svg", "");
        for foreign in ["http:", "https:", "//cdn", "@import", "url("] {
            assert!(!rest.contains(foreign), "{foreign}");
        }
        for markup in
            ["innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", " style="]
        {
            assert!(!text.contains(markup), "{markup}: text from outside would become markup");
        }
        assert!(policy.starts_with("default-src 'none'") && !policy.contains("unsafe"), "{policy}");
        // What is between the tags is what was hashed.
        let script =
            text.split("<script>").nth(1).and_then(|rest| rest.split("</script>").next()).unwrap();
        let hash = base64_simd::STANDARD.encode_to_string(Sha256::digest(script));
        assert!(policy.contains(&format!("script-src 'sha256-{hash}'")), "{policy}");
    }
}
