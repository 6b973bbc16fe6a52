//! The page: one file that needs no other and no network.

use super::markup::escape;
use super::pictures::Pictures;
use super::sections::{
    Section, composite, light, paper_tables, settings, stages, steps, summary, tradeoff,
};
use super::sources::{Problem, Sources};
use crate::output::{OutputError, atomic_write};
use std::path::Path;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// A page, and what is not on it.
#[derive(Clone, Debug)]
pub struct Page {
    /// Well-formed XML as well as HTML.
    pub html: String,
    /// Pictures that could not be read. The page names them too.
    pub problems: Vec<Problem>,
}

/// The page of everything in `sources`.
pub fn page(sources: &Sources) -> Page {
    // pictures of the composite study first: of all, they say most
    let mut pictures = Pictures::default();
    let composite = composite::section(sources, &mut pictures);
    let light = light::section(sources, &mut pictures);
    let stages = stages::section(sources, &mut pictures);
    let problems = pictures.into_problems();
    let sections: Vec<Section> = [
        Some(summary::section(sources, &problems)),
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
    Page { html: assembled(&sections), problems }
}

/// Writes the [`page`] of `sources`. Gives the pictures that could not be read.
pub fn write_report(sources: &Sources, path: &Path) -> Result<Vec<Problem>, OutputError> {
    let page = page(sources);
    atomic_write(path, |out| out.write_all(page.html.as_bytes()))?;
    Ok(page.problems)
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
