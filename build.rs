//! Compiles every shader in `glsl/`, every time: a broken one fails the build with its file and line.
//!
//! Each is compiled twice. The named compile (no optimisation, debug names) is only reflected, since `-O` strips member
//! names; the optimised one is validated and shipped. `OUT_DIR/spirv.rs` gets the words, the bindings, and the offset of
//! every member of every shared block, against which `src/gpu/layout.rs` checks its Rust twins at compile time.

#[path = "build/reflect.rs"]
mod reflect;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{env, fs};

use anyhow::{Context, Result, bail, ensure};

/// Included by others, never compiled alone.
const SHARED: &str = "shared";

fn main() -> Result<()> {
    println!("cargo:rerun-if-changed=glsl");
    println!("cargo:rerun-if-changed=build");
    println!("cargo:rerun-if-env-changed=SURFEL_REQUIRE_SPIRV_VAL");
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?).join("glsl");
    let out = PathBuf::from(env::var("OUT_DIR")?);

    let mut sources = Vec::new();
    collect(&root, &mut sources)?;
    sources.sort();
    ensure!(!sources.is_empty(), "no shader in {}", root.display());

    let compiler = shaderc::Compiler::new().context("shaderc cannot start")?;
    let validator = Validator::find()?;
    let mut shaders = String::new();
    let mut blocks = BTreeMap::new();
    for path in &sources {
        let name = path.strip_prefix(&root)?.to_str().context("shader names are UTF-8")?.replace('\\', "/");
        let source = fs::read_to_string(path)?;
        for &variant in variants(&name) {
            let compile = |optimise| compile(&compiler, &root, path, &source, variant, optimise);
            let (named, shipped) = (compile(false)?, compile(true)?);
            let name = variant.map_or(name.clone(), |v| format!("{name}.{}", v.to_lowercase()));
            validator.check(&name, &shipped)?;
            let module = reflect::Module::parse(&named).with_context(|| format!("reflecting {name}"))?;
            for (block, members) in module.blocks {
                match blocks.get(&block) {
                    Some(known) => ensure!(*known == members, "{name}: block {block} differs from the others' one"),
                    None => drop(blocks.insert(block, members)),
                }
            }
            write_shader(&mut shaders, &name, stage(path)?.1, &shipped, &module.bindings)?;
        }
    }
    ensure!(!blocks.is_empty(), "reflected no block member: have the names been stripped?");

    write_blocks(&mut shaders, &blocks)?;
    fs::write(out.join("spirv.rs"), shaders)?;
    Ok(())
}

fn collect(folder: &Path, into: &mut Vec<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            if path.file_name().is_some_and(|n| n != SHARED) {
                collect(&path, into)?;
            }
        } else {
            into.push(path);
        }
    }
    Ok(())
}

fn stage(path: &Path) -> Result<(shaderc::ShaderKind, &'static str)> {
    Ok(match path.extension().and_then(|e| e.to_str()) {
        Some("vert") => (shaderc::ShaderKind::Vertex, "Vertex"),
        Some("frag") => (shaderc::ShaderKind::Fragment, "Fragment"),
        Some("comp") => (shaderc::ShaderKind::Compute, "Compute"),
        _ => bail!("{}: not a .vert, .frag or .comp file", path.display()),
    })
}

/// What a shader is compiled with, each time by itself: what splats' fragments do, triangles' do as well.
fn variants(name: &str) -> &'static [Option<&'static str>] {
    if name.starts_with("draw/") && name.ends_with(".frag") && name != "draw/occlusion.frag" {
        &[None, Some("TRIANGLE")]
    } else {
        &[None]
    }
}

fn compile(
    compiler: &shaderc::Compiler,
    root: &Path,
    path: &Path,
    source: &str,
    variant: Option<&str>,
    optimise: bool,
) -> Result<Vec<u32>> {
    let mut options = shaderc::CompileOptions::new().context("shaderc options")?;
    if let Some(variant) = variant {
        options.add_macro_definition(variant, None);
    }
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
    options.set_target_spirv(shaderc::SpirvVersion::V1_6);
    options.set_warnings_as_errors();
    if optimise {
        options.set_optimization_level(shaderc::OptimizationLevel::Performance);
    } else {
        options.set_optimization_level(shaderc::OptimizationLevel::Zero);
        options.set_generate_debug_info();
    }
    options.set_include_callback(|wanted, _, from, _| {
        let file = root.join(SHARED).join(wanted);
        let content = fs::read_to_string(&file).map_err(|e| format!("{from} includes {}: {e}", file.display()))?;
        Ok(shaderc::ResolvedInclude { resolved_name: file.display().to_string(), content })
    });
    let file = path.to_str().context("shader names are UTF-8")?;
    let binary = compiler
        .compile_into_spirv(source, stage(path)?.0, file, "main", Some(&options))
        .with_context(|| format!("compiling {file}"))?;
    Ok(binary.as_binary().to_vec())
}

/// `spirv-val`, where it is installed; `SURFEL_REQUIRE_SPIRV_VAL=1` makes it a must, as in CI.
struct Validator(bool);

impl Validator {
    fn find() -> Result<Validator> {
        let found = Command::new("spirv-val").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        let found = found.is_ok_and(|s| s.success());
        ensure!(
            found || env::var_os("SURFEL_REQUIRE_SPIRV_VAL").is_none_or(|v| v != "1"),
            "spirv-val is required here and was not found (Debian: spirv-tools)"
        );
        Ok(Validator(found))
    }

    fn check(&self, name: &str, words: &[u32]) -> Result<()> {
        if !self.0 {
            return Ok(());
        }
        let mut child = Command::new("spirv-val")
            .args(["--target-env", "vulkan1.3", "-"])
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        child.stdin.take().context("spirv-val's input")?.write_all(&bytes)?;
        let done = child.wait_with_output()?;
        ensure!(done.status.success(), "{name} is invalid: {}", String::from_utf8_lossy(&done.stderr));
        Ok(())
    }
}

fn write_shader(out: &mut String, name: &str, stage: &str, words: &[u32], bindings: &[reflect::Binding]) -> Result<()> {
    let constant = name.to_uppercase().replace(['/', '.', '-'], "_");
    writeln!(out, "pub static {constant}: Shader = Shader {{ name: {name:?}, stage: Stage::{stage},")?;
    writeln!(out, "    bindings: &[")?;
    for b in bindings {
        let kind = &b.kind;
        writeln!(out, "        Binding {{ set: {}, binding: {}, kind: Kind::{kind:?} }},", b.set, b.binding)?;
    }
    writeln!(out, "    ],\n    words: &{words:?} }};")?;
    Ok(())
}

fn write_blocks(out: &mut String, blocks: &BTreeMap<String, reflect::Members>) -> Result<()> {
    for (block, members) in blocks {
        let module: String = block.chars().fold(String::new(), |mut s, c| {
            if c.is_uppercase() && !s.is_empty() {
                s.push('_');
            }
            s.push(c.to_ascii_lowercase());
            s
        });
        writeln!(out, "#[allow(missing_docs)] pub mod {module} {{")?;
        for (member, offset) in members {
            writeln!(out, "    pub const {}: usize = {offset};", member.to_uppercase())?;
        }
        writeln!(out, "    pub const MEMBERS: usize = {};\n}}", members.len())?;
    }
    Ok(())
}
