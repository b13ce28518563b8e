use std::collections::BTreeSet;

use super::*;

const ALL: [Kind; 7] = [
    Kind::Pose,
    Kind::Twist,
    Kind::Transform,
    Kind::Path,
    Kind::Numbers,
    Kind::Diagnostics,
    Kind::Battery,
];

fn definition(kind: Kind) -> String {
    match kind.schema() {
        Schema::Ros2(text) => text.to_string(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn each_kind_has_a_name_of_its_own_of_three_parts() {
    let names: BTreeSet<&str> = ALL.iter().map(|kind| kind.name()).collect();
    assert_eq!(names.len(), ALL.len());
    for name in names {
        let parts: Vec<&str> = name.split('/').collect();
        assert!(
            matches!(parts[..], [package, "msg", kind] if !(package.is_empty() || kind.is_empty()))
        );
    }
}

#[test]
fn a_definition_has_every_part_that_it_names_once_and_no_other() {
    for kind in ALL {
        let text = definition(kind);
        let defined: Vec<&str> =
            text.lines().filter_map(|line| line.strip_prefix("MSG: ")).collect();
        let fields = text.lines().filter(|line| !line.starts_with("MSG: "));
        let types = fields.filter_map(|line| line.split_once(' ').map(|(kind, _)| kind));
        let named: BTreeSet<&str> = types
            .map(|kind| kind.trim_end_matches("[]"))
            .filter(|kind| kind.contains('/'))
            .collect();
        let unique: BTreeSet<&str> = defined.iter().copied().collect();
        assert_eq!(unique.len(), defined.len(), "{kind:?} defines a part twice");
        assert_eq!(unique, named, "{kind:?}");
    }
}

#[test]
fn every_field_is_of_a_known_type_and_lines_end() {
    const PRIMITIVE: [&str; 8] =
        ["bool", "byte", "float32", "float64", "int32", "string", "uint32", "uint8"];
    for kind in ALL {
        let text = definition(kind);
        assert!(text.ends_with('\n'), "{kind:?}");
        for line in
            text.lines().filter(|line| !(line.starts_with("MSG: ") || line.starts_with('=')))
        {
            let (kind_of_field, name) = line.split_once(' ').unwrap();
            let plain = kind_of_field.trim_end_matches("[]");
            assert!(PRIMITIVE.contains(&plain) || plain.contains('/'), "{kind:?}: {line}");
            assert!(!name.is_empty() && !name.contains(' '), "{kind:?}: {line}");
        }
    }
}
