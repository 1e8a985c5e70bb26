//! What pages that the program writes share.

/// Text as it stands within HTML, also in attributes.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_becomes_markup() {
        assert_eq!(escaped("<a href=\"x\"> & co"), "&lt;a href=&quot;x&quot;&gt; &amp; co");
    }
}
