//! Pictures of one case under a line that is dragged between two of them.

use crate::report::markup::escape;
use crate::report::pictures::{Pictures, data_uri};
use image::RgbImage;

/// One picture of a case.
pub(in crate::report) struct Choice {
    name: String,
    uri: String,
}

impl Choice {
    /// `None` for a picture that is empty.
    pub fn new(name: &str, picture: &RgbImage) -> Option<Self> {
        Some(Self { name: name.to_owned(), uri: data_uri(picture)? })
    }
}

/// Starts with the pictures `start` on the left and the right. One picture alone is shown without a
/// line; none, or more than the page has room for, gives a note or nothing.
pub(in crate::report) fn slider(
    caption: &str,
    choices: &[Choice],
    start: (usize, usize),
    pictures: &mut Pictures,
) -> String {
    let caption = escape(caption);
    if choices.is_empty() {
        return String::new();
    }
    if !pictures.take(choices.iter().map(|c| c.uri.as_str())) {
        return format!("<p class=\"note\">{caption}: left out to keep this page small.</p>");
    }
    if let [only] = choices {
        let (uri, name) = (&only.uri, escape(&only.name));
        return format!(
            "<figure><img class=\"single\" src=\"{uri}\" alt=\"{caption}, {name}\"/>\
             <figcaption>{caption}, {name}</figcaption></figure>"
        );
    }
    let last = choices.len() - 1;
    let start = (start.0.min(last), start.1.min(last));
    let mut images = String::new();
    for (i, Choice { name, uri }) in choices.iter().enumerate() {
        let class = match (i == start.0, i == start.1) {
            (true, true) => "a b",
            (true, false) => "a",
            (false, true) => "b",
            (false, false) => "",
        };
        let name = escape(name);
        images += &format!(
            "<img class=\"{class}\" src=\"{uri}\" alt=\"{caption}, {name}\" draggable=\"false\"/>"
        );
    }
    let [left, right] = [start.0, start.1].map(|i| escape(&choices[i].name));
    format!(
        "<figure class=\"ab\"><div class=\"ab-stage\">{images}<span class=\"ab-line\"></span>\
         <span class=\"ab-tag ab-left\">{left}</span><span class=\"ab-tag ab-right\">{right}</span>\
         </div><input type=\"range\" min=\"0\" max=\"100\" step=\"1\" value=\"50\" \
         aria-label=\"{caption}: border between the two pictures\"/>\
         <div class=\"ab-bar\"><label>Left {}</label><label>Right {}</label></div>\
         <figcaption>{caption}</figcaption></figure>",
        select(choices, start.0),
        select(choices, start.1)
    )
}

fn select(choices: &[Choice], selected: usize) -> String {
    let mut out = String::from("<select>");
    for (i, choice) in choices.iter().enumerate() {
        let selected = if i == selected { " selected=\"selected\"" } else { "" };
        out += &format!("<option value=\"{i}\"{selected}>{}</option>", escape(&choice.name));
    }
    out + "</select>"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn choices(n: usize) -> Vec<Choice> {
        let picture = RgbImage::new(2, 2);
        (0..n).map(|i| Choice::new(&format!("<{i}>"), &picture).unwrap()).collect()
    }

    #[test]
    fn a_slider_for_any_number_of_pictures() {
        let mut pictures = Pictures::default();
        assert_eq!(slider("case", &[], (0, 1), &mut pictures), "");
        let one = slider("case", &choices(1), (0, 1), &mut pictures);
        assert!(one.contains("<img") && !one.contains("range"));
        let three = slider("case & more", &choices(3), (1, 9), &mut pictures);
        let parsed = roxmltree::Document::parse(&three).unwrap();
        let images: Vec<_> = parsed.descendants().filter(|n| n.has_tag_name("img")).collect();
        let classes: Vec<_> = images.iter().map(|n| n.attribute("class").unwrap()).collect();
        assert_eq!(classes, ["", "a", "b"]);
        assert_eq!(images[2].attribute("alt"), Some("case & more, <2>"));
    }
}
