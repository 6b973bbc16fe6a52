//! Both backends on the same scenes.
