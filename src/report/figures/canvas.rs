//! An SVG that grows mark by mark, and the parts that plots share: panels, axes, legends.

use crate::report::markup::escape;
use crate::report::ticks::Axis;
use std::fmt::Write as _;

const STYLE: &str = include_str!("style.css");

/// Advance of a 12 px character, on the wide side of common fonts.
const CHARACTER_PX: f64 = 6.6;

pub(super) struct Canvas {
    width: f64,
    height: f64,
    name: String,
    body: String,
}

/// Where a text stands relative to its point.
#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Canvas {
    /// `name` is what a screen reader says.
    pub fn new(width: f64, height: f64, name: &str) -> Self {
        Self { width, height, name: name.to_owned(), body: String::new() }
    }

    pub fn line(&mut self, class: &str, from: (f64, f64), to: (f64, f64)) {
        let ((x1, y1), (x2, y2)) = (from, to);
        self.push(format_args!(
            "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>"
        ));
    }

    pub fn rect(&mut self, class: &str, corner: (f64, f64), size: (f64, f64), title: &str) {
        let ((x, y), (w, h)) = (corner, (size.0.max(0.0), size.1.max(0.0)));
        let title = title_element(title);
        self.push(format_args!(
            "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\">\
             {title}</rect>"
        ));
    }

    pub fn circle(&mut self, class: &str, center: (f64, f64), radius: f64, title: &str) {
        let ((x, y), title) = (center, title_element(title));
        self.push(format_args!(
            "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\">{title}</circle>"
        ));
    }

    pub fn polyline(&mut self, class: &str, points: &[(f64, f64)], title: &str) {
        let mut list = String::new();
        for (x, y) in points {
            let _ = write!(list, "{x:.1},{y:.1} "); // a String takes everything
        }
        let title = title_element(title);
        self.push(format_args!(
            "<polyline class=\"{class}\" points=\"{}\">{title}</polyline>",
            list.trim_end()
        ));
    }

    pub fn text(&mut self, class: &str, at: (f64, f64), anchor: Anchor, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let ((x, y), text) = (at, escape(text));
        self.push(format_args!(
            "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>"
        ));
    }

    /// A text that must not be wider than this; what is cut is in its title.
    pub fn fitted(&mut self, class: &str, at: (f64, f64), anchor: Anchor, text: &str, width: f64) {
        let short = shortened(text, width);
        if short == text {
            return self.text(class, at, anchor, text);
        }
        self.body += "<g>";
        self.body += &title_element(text);
        self.text(class, at, anchor, &short);
        self.body += "</g>";
    }

    /// A picture that fills the box; `uri` is trusted, as data URIs made here are.
    pub fn picture(&mut self, uri: &str, corner: (f64, f64), size: (f64, f64)) {
        let ((x, y), (w, h)) = (corner, size);
        self.push(format_args!(
            "<image href=\"{}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\" \
             preserveAspectRatio=\"none\"/>",
            escape(uri)
        ));
    }

    /// Horizontal marks with labels on the left of a panel.
    pub fn y_axis(&mut self, panel: &Panel, axis: &Axis) {
        for tick in &axis.ticks {
            let y = panel.y(axis.share(tick.value));
            self.line("grid", (panel.left, y), (panel.right(), y));
            self.text("soft", (panel.left - 7.0, y + 4.0), Anchor::End, &tick.label);
        }
    }

    /// Vertical marks with labels below a panel.
    pub fn x_axis(&mut self, panel: &Panel, axis: &Axis) {
        for tick in &axis.ticks {
            let x = panel.x(axis.share(tick.value));
            self.line("grid", (x, panel.top), (x, panel.bottom()));
            self.text("soft", (x, panel.bottom() + 16.0), Anchor::Middle, &tick.label);
        }
    }

    /// Swatches with names from `top` downwards; gives the height used.
    pub fn legend(&mut self, left: f64, top: f64, entries: &[(String, String)]) -> f64 {
        let mut at = (left, top + 10.0);
        for (class, name) in entries {
            let width = 18.0 + CHARACTER_PX * name.chars().count() as f64 + 18.0;
            if at.0 > left && at.0 + width > self.width {
                at = (left, at.1 + LEGEND_ROW);
            }
            self.rect(class, (at.0, at.1 - 9.0), (11.0, 11.0), "");
            self.fitted("", (at.0 + 17.0, at.1), Anchor::Start, name, self.width - at.0 - 17.0);
            at.0 += width;
        }
        if entries.is_empty() { 0.0 } else { at.1 - top + 10.0 }
    }

    pub fn finish(self) -> String {
        let Self { width, height, name, body } = self;
        let name = escape(&name);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"kf\" viewBox=\"0 0 {width:.0} \
             {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" \
             style=\"--width:{width:.0}px\" aria-label=\"{name}\"><style>{STYLE}</style>{body}</svg>"
        )
    }

    fn push(&mut self, element: std::fmt::Arguments<'_>) {
        let _ = self.body.write_fmt(element); // a String takes everything
        self.body.push('\n');
    }
}

const LEGEND_ROW: f64 = 19.0;

/// Height that [`Canvas::legend`] will use, for planning.
pub(super) fn legend_height(left: f64, width: f64, names: &[String]) -> f64 {
    let entries: Vec<_> = names.iter().map(|n| (String::new(), n.clone())).collect();
    Canvas::new(width, 0.0, "").legend(left, 0.0, &entries)
}

/// The plot that says that there is nothing to plot.
pub(super) fn nothing(name: &str, why: &str) -> String {
    let mut canvas = Canvas::new(480.0, 60.0, name);
    canvas.text("soft", (240.0, 34.0), Anchor::Middle, why);
    canvas.finish()
}

/// The rectangle that data is drawn in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Panel {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
}

impl Panel {
    pub fn right(&self) -> f64 {
        self.left + self.width
    }

    pub fn bottom(&self) -> f64 {
        self.top + self.height
    }

    pub fn x(&self, share: f64) -> f64 {
        self.left + share * self.width
    }

    pub fn y(&self, share: f64) -> f64 {
        self.bottom() - share * self.height
    }
}

/// The text, or its beginning and `…`, within so many pixels.
fn shortened(text: &str, width: f64) -> String {
    let room = (width / CHARACTER_PX).floor().max(1.0) as usize;
    if text.chars().count() <= room {
        return text.to_owned();
    }
    let start: String = text.chars().take(room - 1).collect();
    format!("{}…", start.trim_end())
}

/// Pixels that a text takes, at most as a rule.
pub(super) fn text_width(text: &str) -> f64 {
    CHARACTER_PX * text.chars().count() as f64
}

fn title_element(title: &str) -> String {
    if title.is_empty() { String::new() } else { format!("<title>{}</title>", escape(title)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_cut_and_kept_in_the_title() {
        assert_eq!(shortened("short", 100.0), "short");
        assert_eq!(shortened("a long name", 40.0), "a lon…");
        assert_eq!(shortened("äöü", 0.0), "…");
        let mut canvas = Canvas::new(10.0, 10.0, "<n>");
        canvas.fitted("", (0.0, 0.0), Anchor::Start, "a <long> name", 40.0);
        let svg = canvas.finish();
        assert!(svg.contains("<title>a &lt;long&gt; name</title>"), "{svg}");
        assert!(roxmltree::Document::parse(&svg).is_ok());
    }

    #[test]
    fn a_legend_wraps() {
        let names: Vec<String> = (0..6).map(|i| format!("method number {i}")).collect();
        assert!(legend_height(0.0, 900.0, &names) < legend_height(0.0, 300.0, &names));
        assert_eq!(legend_height(0.0, 300.0, &[]), 0.0);
    }
}
