//! What the description must not be made of.

/// Most bytes of a tag, and most declarations of namespaces: the parser's time and memory grow with their squares.
const TAG: usize = 4096;
const NAMESPACES: usize = 1000;

/// Refuses what would cost the XML parser more than its length: it compares the attributes of a tag with each other, and
/// copies the namespaces in force.
pub(super) fn check(xml: &[u8]) -> Result<(), &'static str> {
    if xml.windows(5).filter(|w| w == b"xmlns").count() > NAMESPACES {
        return Err("declares too many namespaces");
    }
    let mut rest = xml;
    while let Some(start) = rest.iter().position(|b| *b == b'<') {
        rest = &rest[start..];
        let raw: [(&[u8], &[u8]); 3] = [(b"<!--", b"-->"), (b"<![CDATA[", b"]]>"), (b"<?", b"?>")];
        let end = match raw.iter().find(|(open, _)| rest.starts_with(open)) {
            Some((_, close)) => rest.windows(close.len()).position(|w| w == *close).map(|i| i + close.len()),
            None => {
                let mut quote = None;
                let end = rest.iter().take(TAG).position(|b| match quote {
                    Some(q) => {
                        quote = quote.filter(|_| *b != q);
                        false
                    }
                    None => {
                        quote = matches!(*b, b'"' | b'\'').then_some(*b);
                        *b == b'>'
                    }
                });
                if end.is_none() && rest.len() > TAG {
                    return Err("has a tag of thousands of bytes");
                }
                end.map(|i| i + 1)
            }
        };
        // An end that is missing is the parser's to tell.
        let Some(end) = end else { break };
        rest = &rest[end..];
    }
    Ok(())
}
