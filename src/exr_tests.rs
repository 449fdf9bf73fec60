use super::*;

/// Values of every kind that a float target may hold, coverage and depth as asked.
fn picture(width: u32, height: u32, coverage: bool, depth: bool) -> FloatPicture {
    let specials = [0.0, -0.0, 1e-40, f32::MIN_POSITIVE, 0.1, 1.0, 2.5, -3.0, 65504.0, 1e30, f32::INFINITY];
    let pixels = (width * height) as usize;
    let pixel = |i: usize| {
        let [r, g, b] = [i, i * 3 + 1, i * 7 + 2].map(|k| specials[k % specials.len()] + (i % 5) as f32 * 0.125);
        [r, g, b, if coverage { (i % 9) as f32 / 8.0 } else { 1.0 }]
    };
    let depths = || (0..pixels).map(|i| if i % 4 == 0 { f32::INFINITY } else { 1.0 + i as f32 / 3.0 }).collect();
    FloatPicture {
        width,
        height,
        rgba: (0..pixels).map(pixel).collect(),
        coverage,
        depth: depth.then(depths),
        window: depth.then_some(0.75),
    }
}

fn bits(p: &FloatPicture) -> Vec<u32> {
    p.rgba.iter().flatten().chain(p.depth.iter().flatten()).map(|v| v.to_bits()).collect()
}

fn decode(bytes: &[u8]) -> Result<FloatPicture> {
    FloatPicture::from_bytes(Path::new("some.exr"), bytes)
}

fn encode(picture: &FloatPicture) -> Vec<u8> {
    picture.to_bytes(Path::new("some.exr")).expect("a picture of a size that can be written")
}

fn why(bytes: &[u8]) -> String {
    let text = decode(bytes).expect_err("it must be refused").to_string();
    assert!(text.starts_with("some.exr: "), "{text}");
    text
}

/// Writes the layer as it is given, to make files that this crate does not write.
fn layer(channels: &[&str], size: (usize, usize)) -> Layer<AnyChannels<FlatSamples>> {
    let pixels = size.0 * size.1;
    let plane = || FlatSamples::F16(vec![exr::prelude::f16::from_f32(0.75); pixels]);
    let list = channels.iter().map(|&name| AnyChannel::new(name, plane())).collect();
    Layer::new(size, LayerAttributes::default(), Encoding::UNCOMPRESSED, AnyChannels::sort(list))
}

fn written(layer: Layer<AnyChannels<FlatSamples>>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).expect("a picture");
    bytes.into_inner()
}

#[test]
fn every_bit_comes_back() {
    for (width, height) in [(1, 1), (7, 1), (1, 40), (37, 41)] {
        for (coverage, depth) in [(true, true), (true, false), (false, true), (false, false)] {
            let before = picture(width, height, coverage, depth);
            let bytes = encode(&before);
            assert_eq!(bytes[..4], MAGIC);
            let after = decode(&bytes).expect("what was written");
            assert_eq!((after.width, after.height, after.coverage), (width, height, coverage));
            assert_eq!(after.depth.is_some(), depth);
            assert_eq!(bits(&before), bits(&after));
            assert_eq!(bytes, encode(&before), "the same bytes twice");
        }
    }
}

#[test]
fn files_come_and_go() {
    let path = std::env::temp_dir().join(format!("surfel-exr-{}.exr", std::process::id()));
    let before = picture(5, 4, true, true);
    before.write(&path).expect("a writable folder");
    assert_eq!(bits(&FloatPicture::read(&path).expect("what was written")), bits(&before));
    std::fs::remove_file(&path).expect("it is there");
    let missing = FloatPicture::read(&path).expect_err("it is gone");
    assert!(matches!(&missing, Error::Io { file, .. } if *file == path), "{missing}");
    assert!(before.write(path.join("below")).is_err());
}

#[test]
fn files_of_others() {
    let half = decode(&written(layer(&["R", "G", "B", "Z", "N.x"], (3, 2)))).expect("half floats");
    assert_eq!((half.rgba, half.depth, half.coverage), (vec![[0.75, 0.75, 0.75, 1.0]; 6], Some(vec![0.75; 6]), false));
    assert!(why(&written(layer(&["Y", "A"], (3, 2)))).contains("no channel R"));
    let mut tiled = layer(&["R", "G", "B"], (3, 2));
    tiled.encoding.blocks = Blocks::Tiles(Vec2(8, 8));
    assert!(why(&written(tiled)).contains("tiled"));
    let mut lossy = layer(&["R", "G", "B"], (3, 2));
    lossy.encoding.compression = Compression::B44;
    assert!(why(&written(lossy)).contains("lossy"));
    let mut moved = layer(&["R", "G", "B"], (3, 2));
    moved.attributes.layer_position = Vec2(1, 0);
    let whole = exr::prelude::IntegerBounds::from_dimensions((4, 2));
    let mut bytes = Cursor::new(Vec::new());
    let image = Image::new(exr::prelude::ImageAttributes::new(whole), moved);
    image.write().non_parallel().to_buffered(&mut bytes).expect("a picture");
    assert!(why(bytes.get_ref()).contains("window"));
}

#[test]
fn what_cannot_be_written() {
    let empty = FloatPicture { width: 0, height: 3, rgba: vec![], coverage: true, depth: None, window: None };
    assert!(matches!(empty.to_bytes(Path::new("a.exr")), Err(Error::Data { .. })));
}

#[test]
fn every_cut_is_noticed() {
    let bytes = encode(&picture(9, 35, true, true));
    for cut in 0..bytes.len() {
        why(&bytes[..cut]);
    }
    why(b"no picture at all");
}

#[test]
fn a_header_that_promises_too_much_is_not_believed() {
    // The two windows of the header become 2²⁹ × 2²⁹ pixels.
    let mut bytes = encode(&picture(9, 35, true, true));
    let corner: Vec<u8> = [8i32, 34].into_iter().flat_map(i32::to_le_bytes).collect();
    let places: Vec<usize> = (0..bytes.len() - 8).filter(|&i| bytes[i..i + 8] == corner[..]).collect();
    assert_eq!(places.len(), 2, "data window and display window");
    for place in places {
        for side in 0..2 {
            bytes[place + 4 * side..][..4].copy_from_slice(&((1 << 29) - 1i32).to_le_bytes());
        }
    }
    assert!(why(&bytes).contains("cannot be in"), "{}", why(&bytes));
}

#[test]
fn flipped_bits_do_no_harm() {
    let unharmed = |bytes: &[u8]| {
        for bit in 0..bytes.len() * 8 {
            let mut broken = bytes.to_vec();
            broken[bit / 8] ^= 1 << (bit % 8);
            if let Ok(p) = decode(&broken) {
                let pixels = p.width as usize * p.height as usize;
                assert!(p.rgba.len() == pixels && p.depth.is_none_or(|d| d.len() == pixels));
            }
        }
    };
    unharmed(&encode(&picture(6, 33, true, true)));
    // Other programs compress otherwise.
    for compression in [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::PIZ] {
        let mut other = layer(&["R", "G", "B", "A", "Z"], (9, 17));
        let ramp = (0..9 * 17).map(|i| i as f32 * 0.37).collect();
        other.channel_data.list[4].sample_data = FlatSamples::F32(ramp);
        other.encoding = Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
        unharmed(&written(other));
    }
}
