//! What an answer's head says, as far as ranges of a file need it (RFC 9110).

use ureq::http::{HeaderMap, Response, header};

use super::client::Problem;
use crate::stream::FaultKind;

/// Which version of a file: what must stay the same from one answer to the next.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Version {
    pub etag: Option<String>,
    pub modified: Option<String>,
}

/// RFC 9110, section 14.4: `bytes FIRST-LAST/TOTAL`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ContentRange {
    pub first: u64,
    pub last: u64,
    /// Not given as `*`.
    pub total: Option<u64>,
}

#[derive(Debug)]
pub(super) struct Head {
    pub status: u16,
    pub version: Version,
    pub range: Option<ContentRange>,
    /// Of the body, where the server says it.
    pub length: Option<u64>,
    /// From `bytes */TOTAL`, which comes with status 416.
    pub total: Option<u64>,
    /// Seconds to wait; the form with a date is not read.
    pub retry_after: Option<u64>,
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).and_then(|v| v.to_str().ok()).map(str::trim)
}

fn number(digits: &str) -> Option<u64> {
    digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse().ok()).flatten()
}

fn content_range(value: &str) -> Option<(Option<ContentRange>, Option<u64>)> {
    let (unit, rest) = value.split_once(' ')?;
    let (range, total) = rest.trim().split_once('/')?;
    let total = if total == "*" { None } else { Some(number(total)?) };
    if !unit.eq_ignore_ascii_case("bytes") {
        return None;
    }
    if range == "*" {
        return Some((None, total));
    }
    let (first, last) = range.split_once('-')?;
    let (first, last) = (number(first)?, number(last)?);
    let sane = first <= last && total.is_none_or(|t| last < t);
    sane.then_some((Some(ContentRange { first, last, total }), total))
}

impl Head {
    pub(super) fn of(response: &Response<ureq::Body>) -> Result<Head, Problem> {
        let headers = response.headers();
        let status = response.status().as_u16();
        let coding = text(headers, header::CONTENT_ENCODING).filter(|c| !c.is_empty());
        if let Some(coding) = coding.filter(|c| matches!(status, 200 | 206) && !c.eq_ignore_ascii_case("identity")) {
            let why = format!("the server sends the file encoded as {coding}, though it was asked not to");
            return Err(Problem::new(FaultKind::Protocol, why));
        }
        let (range, total) = match text(headers, header::CONTENT_RANGE) {
            None => (None, None),
            Some(value) => content_range(value).ok_or_else(|| {
                Problem::new(FaultKind::Protocol, format!("the server sent a Content-Range that says nothing: {value}"))
            })?,
        };
        let owned = |name| text(headers, name).map(str::to_owned);
        Ok(Head {
            status,
            version: Version { etag: owned(header::ETAG), modified: owned(header::LAST_MODIFIED) },
            range,
            length: response.body().content_length(),
            total,
            retry_after: text(headers, header::RETRY_AFTER).and_then(number),
        })
    }

    /// What to do about an answer that brings no bytes.
    pub(super) fn problem(&self) -> Problem {
        let (kind, why) = match self.status {
            501 | 505 => (FaultKind::Refused, "the server cannot do it"),
            408 | 425 | 429 | 500..=599 => (FaultKind::Busy, "the server cannot do it now"),
            404 | 410 => (FaultKind::Refused, "there is no such file"),
            401 | 403 | 407 => (FaultKind::Refused, "the server does not allow it"),
            416 => (FaultKind::Refused, "the server does not have this range"),
            _ => (FaultKind::Refused, "the server does not send the file"),
        };
        Problem::new(kind, format!("{why} (status {})", self.status))
    }
}

impl Version {
    /// For `If-Range`: a strong entity tag, else the date (RFC 9110, section 13.1.5).
    pub(super) fn condition(&self) -> Option<&str> {
        self.etag.as_deref().filter(|e| !e.starts_with("W/")).or(self.modified.as_deref())
    }

    /// What shows that `now` is another version. Tags go before dates; what one of them lacks shows nothing.
    pub(super) fn differs(&self, now: &Version) -> Option<String> {
        let opaque = |tag: &str| tag.trim_start_matches("W/").to_owned();
        match (&self.etag, &now.etag, &self.modified, &now.modified) {
            (Some(a), Some(b), ..) => (opaque(a) != opaque(b)).then(|| format!("its ETag was {a} and is {b}")),
            (_, _, Some(a), Some(b)) => (a != b).then(|| format!("its Last-Modified was {a} and is {b}")),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_or_refused() {
        let range = |first, last, total| Some((Some(ContentRange { first, last, total }), total));
        assert_eq!(content_range("bytes 5-9/10"), range(5, 9, Some(10)));
        assert_eq!(content_range("Bytes 0-0/*"), range(0, 0, None));
        assert_eq!(content_range("bytes */77"), Some((None, Some(77))));
        let wrong =
            ["", "bytes", "bytes 1-2", "lines 1-2/3", "bytes 2-1/3", "bytes 1-3/3", "bytes +1-2/3", "bytes 1-2/+3"];
        for value in
            wrong.into_iter().chain(["bytes 1-2/", "bytes -2/3", "bytes 1-99999999999999999999/*", "bytes=1-2/3"])
        {
            let got = content_range(value);
            assert!(got.is_none(), "{value:?}: {got:?}");
        }
    }

    #[test]
    fn versions_differ_by_what_both_have() {
        let version = |etag: Option<&str>, modified: Option<&str>| Version {
            etag: etag.map(Into::into),
            modified: modified.map(Into::into),
        };
        let opened = version(Some("\"a\""), Some("Mon"));
        assert_eq!(opened.differs(&version(Some("W/\"a\""), Some("Tue"))), None, "the tag decides");
        assert!(opened.differs(&version(Some("\"b\""), Some("Mon"))).is_some());
        assert!(opened.differs(&version(None, Some("Tue"))).is_some());
        assert_eq!(opened.differs(&version(None, None)), None);
        assert_eq!(opened.condition(), Some("\"a\""));
        assert_eq!(version(Some("W/\"a\""), Some("Mon")).condition(), Some("Mon"), "a weak tag is no condition");
        assert_eq!(version(Some("W/\"a\""), None).condition(), None);
    }
}
