//! Text for HTML and SVG. Both are written so that an XML parser takes them too.

/// Makes any text safe as content and as a quoted attribute. Control characters that XML has no
/// place for become U+FFFD.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// A number for people, `–` where there is none.
pub(super) fn number(value: impl Into<Option<f64>>, digits: usize) -> String {
    match value.into().filter(|v| v.is_finite()) {
        Some(value) => {
            let text = format!("{value:.digits$}");
            // no "-0.0"
            match text.strip_prefix('-') {
                Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
                _ => text.replace('-', "\u{2212}"),
            }
        }
        None => "–".to_owned(),
    }
}

/// Milliseconds, frame rates and their like: three digits that count.
pub(super) fn three_digits(value: impl Into<Option<f64>>) -> String {
    let value = value.into();
    let digits = match value {
        Some(v) if v.abs() >= 99.95 => 0,
        Some(v) if v.abs() >= 9.995 => 1,
        _ => 2,
    };
    number(value, digits)
}

/// `12.3x` with a true multiplication sign.
pub(super) fn factor(value: impl Into<Option<f64>>) -> String {
    match value.into().filter(|v| v.is_finite()) {
        Some(v) => format!("{}\u{d7}", three_digits(v)),
        None => "–".to_owned(),
    }
}

/// A table whose first `text_columns` are text and whose others are numbers. Head and cells are HTML:
/// plain text must have been escaped.
pub(super) fn table(head: &[&str], rows: &[Vec<String>], text_columns: usize) -> String {
    let class = |column: usize| if column < text_columns { " class=\"text\"" } else { "" };
    let mut out = String::from("<div class=\"scroll\"><table><thead><tr>");
    for (i, cell) in head.iter().enumerate() {
        out += &format!("<th{} scope=\"col\">{cell}</th>", class(i));
    }
    out += "</tr></thead><tbody>";
    for row in rows {
        out += "<tr>";
        for (i, cell) in row.iter().enumerate() {
            out += &match i {
                0 => format!("<th{} scope=\"row\">{cell}</th>", class(i)),
                _ => format!("<td{}>{cell}</td>", class(i)),
            };
        }
        out += "</tr>";
    }
    out + "</tbody></table></div>"
}

/// Words joined as a sentence has them: "a", "a and b", "a, b and c".
pub(super) fn listed(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [rest @ .., last] => format!("{} and {last}", rest.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_is_escaped() {
        assert_eq!(escape("<a href=\"x\">'&"), "&lt;a href=&quot;x&quot;&gt;&#39;&amp;");
        assert_eq!(escape("a\u{0}b\u{1b}c\nd"), "a\u{fffd}b\u{fffd}c\nd");
    }

    #[test]
    fn numbers_are_for_people() {
        assert_eq!(number(1.25, 1), "1.2");
        assert_eq!(number(-0.01, 1), "0.0");
        assert_eq!(number(-2.5, 2), "\u{2212}2.50");
        assert_eq!(number(f64::NAN, 1), "–");
        assert_eq!(number(None, 1), "–");
        assert_eq!(three_digits(123.4), "123");
        assert_eq!(three_digits(12.34), "12.3");
        assert_eq!(three_digits(99.96), "100");
        assert_eq!(three_digits(0.123), "0.12");
        assert_eq!(factor(f64::INFINITY), "–");
        assert_eq!(factor(3.0), "3.00\u{d7}");
    }

    #[test]
    fn lists_read_as_sentences() {
        let words: Vec<String> = ["a", "b", "c"].map(String::from).to_vec();
        assert_eq!(listed(&words), "a, b and c");
        assert_eq!(listed(&words[..1]), "a");
        assert_eq!(listed(&[]), "");
    }
}
