//! Where signals are not those of Unix: Ctrl-C alone.

pub fn catch(end: impl FnOnce() + Send + 'static) -> Result<(), ctrlc::Error> {
    let mut end = Some(end);
    ctrlc::set_handler(move || match end.take() {
        Some(end) => end(),
        None => std::process::exit(exit_code().into()),
    })
}

pub fn exit_code() -> u8 {
    130
}

pub fn die() {}

pub fn limits_are_errors() {}
