//! Measures of a result against the truth: camera path, picture, light, transfer.

pub mod flip;
pub mod light;
pub mod picture;
pub mod trajectory;
pub mod transfer;

/// What keeps a measure from being taken.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    #[error("{path}: {source}")]
    Io { path: String, source: std::io::Error },
    #[error("{path}: {problem}")]
    File { path: String, problem: String },
    #[error(
        "only {matched} of {estimated} estimated poses have a reference pose within \
         {tolerance_s} s, {needed} are needed; are both paths of the same recording, with the same clock?"
    )]
    FewMatches { matched: usize, estimated: usize, tolerance_s: f64, needed: usize },
    #[error("pictures of different size: {0} and {1}")]
    SizeMismatch(crate::image::Size, crate::image::Size),
    #[error("a picture of {size} is smaller than the {window}x{window} window of the measure")]
    PictureTooSmall { size: crate::image::Size, window: usize },
    #[error("{0}")]
    Undefined(String),
}
