use glam::{Vec3, dvec3};

use surfel::structure::layered::Node;
use surfel::structure::nodes::NONE;

use super::super::extent::Extent;
use super::*;
use surfel::structure::layered::Index;

/// A root over a row of leaves, one at each place, as an index has them.
fn index(places: &[Vec3]) -> Index {
    let node = |centre, ball, split, parent| Node {
        centre,
        ball,
        reach: 0.1,
        axis: Vec3::Z,
        cone: -1.0,
        spacing: 0.1,
        published: 0.1,
        split,
        plane: 0.0,
        children: [NONE; 2],
        parent,
        level: u8::from(parent != NONE),
        samples: 100,
        at: 0,
        bytes: 1,
        checksum: 0,
    };
    let mut nodes = vec![node(Vec3::ZERO, 100.0, 0, NONE)];
    nodes.extend(places.iter().map(|&p| node(p, 0.5, 3, 0)));
    // Two are enough to say that the root is no leaf.
    nodes[0].children = [1, 2];
    Index { origin: dvec3(1000.0, 2000.0, 30.0), nodes, ..Index::default() }
}

/// 101 leaves along x from −50 to 50, on ground that rises from 0 to 10, and one far outlier above.
fn slope() -> Extent {
    let mut places: Vec<Vec3> = (0..=100).map(|i| Vec3::new(i as f32 - 50.0, 0.0, 0.1 * i as f32)).collect();
    places.push(Vec3::new(0.0, 0.0, 5000.0));
    Extent::of(&index(&places), DVec3::Z).unwrap()
}

#[test]
fn an_extent_is_the_box_without_outliers() {
    let e = slope();
    // The longer side lies along x, either way; 1 % of 102 leaves on either side is one or two of them.
    assert_eq!(e.axes[0].abs(), DVec3::X);
    assert!((e.half[0] - 50.5).abs() <= 2.0, "{:?}", e.half);
    assert!(e.half[2] < 10.0, "the outlier is 5000 up: {:?}", e.half);
    assert!((e.centre - dvec3(1000.0, 2000.0, 35.0)).abs().max_element() <= 2.0, "{}", e.centre);
    assert!(Extent::of(&Index::default(), DVec3::Z).is_none());
}

#[test]
fn a_point_has_an_extent_too() {
    let mut index = index(&[]);
    index.nodes[0].children = [NONE; 2];
    (index.nodes[0].ball, index.nodes[0].spacing) = (0.0, 0.0);
    let e = Extent::of(&index, DVec3::Y).unwrap();
    assert!(e.half.iter().all(|h| *h > 0.0));
    for path in [Path::orbit(&e, None), Path::approach(&e, None), Path::street(&e, None)] {
        let key = path.key(0, 1);
        let view = Camera::new(&e, 0.8, 1.5).view(key);
        assert!(view.view.is_finite() && view.projection.is_finite(), "{path:?}: {key:?}");
    }
}

#[test]
fn paths_are_functions_of_extent_and_frame() {
    for of in [Path::orbit, Path::approach, Path::street] {
        let (path, again) = (of(&slope(), None), of(&slope(), None));
        for frame in [0, 1, 7, 299] {
            assert_eq!(path.key(frame, 300), again.key(frame, 300));
        }
        assert_ne!(path.key(0, 300), path.key(100, 300));
        // One frame is the first of any number.
        assert_eq!(path.key(0, 1), path.key(0, 300));
    }
}

#[test]
fn orbits_keep_their_distance_and_close() {
    let e = slope();
    let path = Path::orbit(&e, None);
    let keys: Vec<Key> = (0..8).map(|i| path.key(i, 8)).collect();
    for key in &keys {
        // Rotations keep lengths up to rounding.
        assert!(((key.eye - e.centre).length() / (2.0 * e.radius()) - 1.0).abs() < 1e-12);
        assert_eq!(key.target, e.centre);
    }
    let step = |a: &Key, b: &Key| (a.eye - b.eye).length();
    assert!(
        (step(&keys[7], &keys[0]) / step(&keys[0], &keys[1]) - 1.0).abs() < 1e-9,
        "the last step is like the first"
    );
    let start = Key { eye: dvec3(5.0, 0.0, 1.0), target: dvec3(0.0, 0.0, 1.0) };
    let half = Path::orbit(&e, Some(start)).key(1, 2);
    assert!((half.eye - dvec3(-5.0, 0.0, 1.0)).length() < 1e-12, "{half:?}");
}

#[test]
fn approaches_come_near_and_leave() {
    let e = slope();
    let path = Path::approach(&e, None);
    let away = |frame| {
        let key = path.key(frame, 100);
        (key.eye - key.target).length()
    };
    assert!((away(0) / (4.0 * e.radius()) - 1.0).abs() < 1e-12);
    // Twice the ball of a leaf.
    assert!((away(50) - 1.0).abs() < 1e-9, "{}", away(50));
    assert!((0..50).all(|i| away(i + 1) < away(i)) && (50..99).all(|i| away(i + 1) > away(i)));
}

#[test]
fn streets_follow_the_ground() {
    let e = slope();
    let path = Path::street(&e, None);
    let keys: Vec<Key> = (0..=32).map(|i| path.key(i, 33)).collect();
    let length = 2.0 * e.half[0];
    for key in &keys {
        // The ground at x is 0.1 (x + 50), that of the lowest tenth of what lies within a station of it is up to a station lower.
        let over = key.eye.z - (30.0 + 0.1 * (key.eye.x - 1000.0 + 50.0)) - EYE_LEVEL * length;
        let station = length / STATIONS as f64;
        assert!((-0.1 * station - 0.1..=0.1).contains(&over), "{over} over eye level at {}", key.eye.x);
        assert!((key.target - key.eye).normalize().abs_diff_eq(e.axes[0], 1e-12), "it looks along the street");
    }
    assert!(((keys[32].eye - keys[0].eye).dot(e.axes[0]) - 0.9 * length).abs() < 1e-9 * length);
    let (eye, target) = (dvec3(0.0, 0.0, 1.0), dvec3(8.0, 0.0, 3.0));
    let straight = Path::street(&e, Some(Key { eye, target }));
    assert!((straight.key(1, 5).eye - eye.lerp(target, 0.25)).length() < 1e-12);
    assert!((straight.key(4, 5).eye - target).length() < 1e-12);
}

#[test]
fn key_frames_are_met_and_smooth() {
    let text = r#"{"keys": [{"eye": [0, 0, 0], "target": [0, 1, 0]}, {"eye": [1, 0, 0], "target": [0, 1, 0]},
                            {"eye": [1, 2, 0], "target": [0, 1, 5]}]}"#;
    let path = parse(text).unwrap();
    assert_eq!(path.key(0, 201).eye, DVec3::ZERO);
    assert_eq!(path.key(100, 201).eye, DVec3::X);
    assert_eq!(path.key(200, 201), Key { eye: dvec3(1.0, 2.0, 0.0), target: dvec3(0.0, 1.0, 5.0) });
    // At the middle key the velocity is half the difference of its neighbours from both sides: (1, 2, 0) / 2 a key, in 100 frames.
    let step = |i: u32| 100.0 * (path.key(i + 1, 201).eye - path.key(i, 201).eye);
    // A step's mean differs from the velocity by up to half the acceleration times a hundredth of a key; that is below 8 here.
    assert!((step(99) - step(100)).length() < 0.08, "{} {}", step(99), step(100));
    assert!((step(100) - dvec3(0.5, 1.0, 0.0)).length() < 0.04);
    let still = parse(r#"{"keys": [{"eye": [1, 2, 3], "target": [0, 0, 0]}]}"#).unwrap();
    assert_eq!(still.key(0, 9), still.key(8, 9));
}

#[test]
fn key_files_are_refused_by_place() {
    for (text, says) in [
        ("{", "EOF"),
        ("[]", "the file: an object with keys"),
        ("{}", "keys: is missing"),
        (r#"{"keys": []}"#, "at least one place"),
        (r#"{"keys": [{"eye": [0, 0, 0]}]}"#, "keys[0].target: is missing"),
        (r#"{"keys": [{"eye": [0, 0], "target": [0, 0, 1]}]}"#, "keys[0].eye: three numbers"),
        (r#"{"keys": [{"eye": [0, 0, 0], "target": [0, 0, 0]}]}"#, "keys[0]: eye and target are the same"),
        (r#"{"keys": [{"eye": [0, 0, 0], "target": [0, 0, 1], "up": 1}]}"#, "keys[0].up: unknown"),
    ] {
        let error = format!("{:#}", parse(text).unwrap_err());
        assert!(error.contains(says), "{text}: {error}");
    }
}

#[test]
fn no_direction_is_too_much_for_a_camera() {
    let camera = Camera::new(&slope(), 0.8, 1.5);
    let eye = dvec3(1.0, 2.0, 3.0);
    for target in [eye, eye + DVec3::Z, eye - DVec3::Z, eye + DVec3::X] {
        let view = camera.view(Key { eye, target });
        assert!(view.view.is_finite(), "{target}: {view:?}");
        assert!((view.eye().truncate() - eye).length() < 1e-9);
    }
}
