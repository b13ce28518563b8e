use super::*;

#[test]
fn every_channel_stands_once_in_the_order_of_the_type_and_is_found_by_its_name() {
    for &topic in Topic::ALL {
        assert_eq!(Topic::named(topic.name()), Some(topic));
    }
    assert_eq!(Topic::named("/cycle"), None);
}

#[test]
fn channels_of_one_kind_of_record_have_one_schema() {
    for topic in Topic::ALL {
        for other in Topic::ALL {
            if topic.schema_name() == other.schema_name() {
                assert_eq!(
                    topic.schema(&[], &[]),
                    other.schema(&[], &[]),
                    "{topic:?} and {other:?}"
                );
            }
        }
    }
}
