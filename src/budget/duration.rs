//! Budgets as text.

use super::BudgetError;
use std::time::Duration;

/// Longer than any frame takes.
const LONGEST_S: f64 = 3600.0;

/// A number with `ms` or `s` behind it: `33ms`, `0.1s`.
pub fn parse_budget(text: &str) -> Result<Duration, BudgetError> {
    let wrong = |problem| BudgetError::Budget { given: text.to_owned(), problem };
    let trimmed = text.trim();
    let (number, unit_s) = match trimmed.strip_suffix("ms") {
        Some(number) => (number, 1e-3),
        None => (trimmed.strip_suffix('s').ok_or_else(|| wrong("it needs a unit, ms or s"))?, 1.0),
    };
    let seconds = unit_s * number.trim_end().parse::<f64>().map_err(|_| wrong("not a number"))?;
    match seconds > 0.0 && seconds <= LONGEST_S {
        true => Ok(Duration::from_secs_f64(seconds)),
        false => Err(wrong("it must be above 0 and at most an hour")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn milliseconds_and_seconds() {
        for (text, us) in
            [("33ms", 33_000), ("0.1s", 100_000), (" 400 ms ", 400_000), ("2s", 2_000_000)]
        {
            assert_eq!(parse_budget(text).unwrap(), Duration::from_micros(us), "{text}");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, word) in [
            ("33", "unit"),
            ("", "unit"),
            ("ms", "not a number"),
            ("1e3x ms", "not a number"),
            ("-1ms", "above 0"),
            ("0s", "above 0"),
            ("NaNms", "above 0"),
            ("infs", "above 0"),
            ("3601s", "hour"),
        ] {
            let message = parse_budget(text).unwrap_err().to_string();
            assert!(message.contains(word) && message.contains("33ms"), "{text}: {message}");
        }
    }
}
