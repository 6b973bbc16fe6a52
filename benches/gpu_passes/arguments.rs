//! What is asked for.

use kinlight::gpu::AdapterChoice;

const PRESETS: [&str; 4] = ["ours-fast", "ours", "gr14", "gr12"];

pub struct Arguments {
    pub adapter: AdapterChoice,
    /// Measured frames of each preset.
    pub frames: usize,
    /// A row for each shader.
    pub kernels: bool,
    pub presets: Vec<&'static str>,
    /// Parts of names of rows; all rows where there is none.
    filters: Vec<String>,
}

impl Arguments {
    /// Words that name a preset choose it; others are parts of names of rows.
    pub fn parse(words: impl Iterator<Item = String>) -> Result<Self, String> {
        let mut parsed = Self {
            adapter: AdapterChoice::Best,
            frames: 3,
            kernels: false,
            presets: Vec::new(),
            filters: Vec::new(),
        };
        let mut words = words;
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
            match word.as_str() {
                // cargo's own
                "--bench" => {}
                "--kernels" => parsed.kernels = true,
                "--adapter" => parsed.adapter = AdapterChoice::Named(value()?),
                "--frames" => {
                    let frames = value()?.parse().ok().filter(|&n| n > 0);
                    parsed.frames = frames.ok_or("--frames needs a number from 1 on")?;
                }
                option if option.starts_with("--") => return Err(format!("{option} is unknown")),
                name => match PRESETS.iter().find(|&&preset| preset == name) {
                    Some(preset) => parsed.presets.push(preset),
                    None => parsed.filters.push(name.to_lowercase()),
                },
            }
        }
        if parsed.presets.is_empty() {
            parsed.presets = PRESETS.to_vec();
        }
        Ok(parsed)
    }

    pub fn wants(&self, row: &str) -> bool {
        let row = row.to_lowercase();
        self.filters.is_empty() || self.filters.iter().any(|part| row.contains(part))
    }
}
