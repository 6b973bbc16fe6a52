//! The page: one file that needs no other and no network.

use super::markup::escape;
use super::pictures::Budget;
use super::sections::{
    Section, composite, light, paper_tables, settings, stages, steps, summary, tradeoff,
};
use super::sources::Sources;
use crate::output::{OutputError, atomic_write};
use std::path::Path;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// The page of everything in `sources`. It is well-formed XML as well as HTML.
pub fn page(sources: &Sources) -> String {
    // pictures of the composite study first: of all, they say most
    let mut budget = Budget::default();
    let composite = composite::section(sources, &mut budget);
    let light = light::section(sources, &mut budget);
    let stages = stages::section(sources, &mut budget);
    let sections: Vec<Section> = [
        Some(summary::section(sources)),
        paper_tables::section(sources),
        stages,
        light,
        steps::section(sources),
        tradeoff::section(sources),
        composite,
        Some(settings::section(sources)),
    ]
    .into_iter()
    .flatten()
    .filter(|section| !section.html.is_empty())
    .collect();
    assembled(&sections)
}

/// Writes the [`page`] of `sources`.
pub fn write_report(sources: &Sources, path: &Path) -> Result<(), OutputError> {
    let page = page(sources);
    atomic_write(path, |out| out.write_all(page.as_bytes()))
}

fn assembled(sections: &[Section]) -> String {
    let mut links = String::new();
    let mut body = String::new();
    for Section { id, title, html } in sections {
        links += &format!("<a href=\"#{id}\">{title}</a>");
        body += &format!("<section id=\"{id}\"><h2>{title}</h2>\n{html}</section>\n");
    }
    let version = escape(env!("CARGO_PKG_VERSION"));
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\
         <meta name=\"color-scheme\" content=\"light dark\"/>\
         <link rel=\"icon\" href=\"data:,\"/>\
         <title>kinlight report</title>\n<style>{STYLE}</style></head>\n\
         <body><header><h1>kinlight <span>report</span></h1><nav>{links}</nav></header>\n\
         <main>{body}</main>\n\
         <footer>kinlight {version}, after Gruber, Ventura, Schmalstieg: Image-Space Illumination for \
         Augmented Reality in Dynamic Environments (2015)</footer>\n\
         <script>{SCRIPT}</script></body></html>\n"
    )
}
