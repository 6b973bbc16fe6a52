//! The page's sections. Each says nothing where there is nothing to say.

pub(super) mod composite;
pub(super) mod light;
pub(super) mod paper_tables;
pub(super) mod settings;
pub(super) mod slider;
pub(super) mod stages;
pub(super) mod steps;
pub(super) mod summary;
pub(super) mod tradeoff;

use super::figures::class_of;
use super::markup::escape;

/// A titled part of the page.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Section {
    /// Anchor.
    pub id: &'static str,
    pub title: &'static str,
    pub html: String,
}

/// A plot with what it shows below it; the caption is HTML.
fn figure(svg: &str, caption: &str) -> String {
    format!("<figure><div class=\"scroll\">{svg}</div><figcaption>{caption}</figcaption></figure>")
}

/// Swatches of methods, for figures that have none of their own.
fn legend(methods: &[String]) -> String {
    let mut out = String::from("<p class=\"kf legend\">");
    for method in methods {
        let (class, name) = (class_of(method), escape(method));
        out += &format!(
            "<span><svg width=\"12\" height=\"12\" aria-hidden=\"true\"><circle class=\"f{class}\" \
             cx=\"6\" cy=\"6\" r=\"5\"/></svg> {name}</span>"
        );
    }
    out + "</p>"
}

fn depth_name(sensor_noise: bool) -> &'static str {
    if sensor_noise { "sensor noise" } else { "exact depth" }
}
