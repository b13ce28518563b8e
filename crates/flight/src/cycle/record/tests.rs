//! The channels by name.

use std::collections::BTreeSet;

use super::*;

#[test]
fn every_channel_is_listed_once_and_found_by_its_name() {
    for topic in Topic::ALL {
        assert_eq!(Topic::named(topic.name()), Some(topic));
    }
    let names: BTreeSet<&str> = Topic::ALL.iter().map(|topic| topic.name()).collect();
    assert_eq!(names.len(), Topic::ALL.len(), "a channel twice, or two of one name");
    assert_eq!(Topic::named("/estim"), None);
    assert_eq!(Topic::named(""), None);
}
