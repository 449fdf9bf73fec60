//! What is finished, line by line, so that a sweep that was interrupted goes on where it was.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde_json::Value;

use super::record::Record;

/// A file of JSON lines: what all records have in common, then a record a line.
pub struct Journal {
    path: PathBuf,
    file: File,
    /// By key.
    done: HashMap<String, Record>,
}

impl Journal {
    /// Opens the journal of `folder`, or begins it. `common` is what all its records must have been measured with.
    pub fn open(folder: &Path, common: &Value) -> Result<Journal> {
        let path = folder.join("journal.jsonl");
        let name = || path.display().to_string();
        let mut done = HashMap::new();
        // The end of the last whole line: a line that was cut short is measured again.
        let mut whole = 0;
        if path.exists() {
            let mut reader = BufReader::new(File::open(&path).with_context(name)?);
            let mut line = String::new();
            for number in 1.. {
                line.clear();
                let read = reader.read_line(&mut line).with_context(name)?;
                if read == 0 || !line.ends_with('\n') {
                    break;
                }
                let broken =
                    || format!("{}: line {number}: not a line of a journal; remove the folder to begin again", name());
                if number == 1 {
                    let before: Value = serde_json::from_str(&line).with_context(broken)?;
                    differences(&before, common).map_or(Ok(()), |what| {
                        bail!(
                            "{}: this folder holds a bench of another kind ({what}): choose or remove one",
                            folder.display()
                        )
                    })?;
                } else {
                    let record: Record = serde_json::from_str(&line).with_context(broken)?;
                    done.insert(record.combination.key(), record);
                }
                whole += read as u64;
            }
        }
        let file = OpenOptions::new().create(true).append(true).open(&path).with_context(name)?;
        file.set_len(whole).with_context(name)?;
        let mut journal = Journal { path, file, done };
        if whole == 0 {
            journal.line(common)?;
        }
        Ok(journal)
    }

    /// The record of this key, if it is finished.
    pub fn get(&self, key: &str) -> Option<&Record> {
        self.done.get(key)
    }

    /// Keeps a record, for good once this returns.
    pub fn add(&mut self, record: Record) -> Result<()> {
        self.line(&record)?;
        self.done.insert(record.combination.key(), record);
        Ok(())
    }

    fn line(&mut self, value: &impl serde::Serialize) -> Result<()> {
        let text = serde_json::to_string(value)? + "\n";
        self.file.write_all(text.as_bytes()).with_context(|| self.path.display().to_string())
    }
}

/// The first key in which two objects differ, and how.
fn differences(before: &Value, now: &Value) -> Option<String> {
    let (Some(before), Some(now)) = (before.as_object(), now.as_object()) else { return Some("not a journal".into()) };
    let keys = before.keys().chain(now.keys());
    keys.filter(|k| before.get(*k) != now.get(*k))
        .map(|k| {
            let show = |v: Option<&Value>| v.map_or("nothing".into(), Value::to_string);
            format!("{k} was {}, now {}", show(before.get(k)), show(now.get(k)))
        })
        .next()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::record::tests::record;
    use super::*;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Folder {
            let path = std::env::temp_dir().join(format!("surfel-journal-{name}-{}", std::process::id()));
            std::fs::create_dir_all(&path).unwrap();
            Folder(path)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn a_sweep_goes_on_where_it_was_cut() {
        let folder = Folder::new("cut");
        let common = json!({"device": "d"});
        let (a, b) = (record("a", 1.0, 0.1), record("b", 2.0, 0.2));
        let mut journal = Journal::open(&folder.0, &common).unwrap();
        journal.add(a.clone()).unwrap();
        journal.add(b.clone()).unwrap();
        drop(journal);
        let path = folder.0.join("journal.jsonl");
        let bytes = std::fs::read(&path).unwrap();
        // Cut anywhere in the last line: it is gone, the one before is not, and what follows is whole again.
        let last = bytes[..bytes.len() - 1].iter().rposition(|b| *b == b'\n').unwrap() + 1;
        for cut in [last, last + 1, bytes.len() - 2, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let mut journal = Journal::open(&folder.0, &common).unwrap();
            assert!(journal.get(&a.combination.key()).is_some() && journal.get(&b.combination.key()).is_none());
            journal.add(b.clone()).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), bytes, "cut at {cut}");
        }
        // Cut within the first line: begun again.
        std::fs::write(&path, &bytes[..3]).unwrap();
        assert!(Journal::open(&folder.0, &common).unwrap().get(&a.combination.key()).is_none());
    }

    #[test]
    fn another_device_is_another_bench() {
        let folder = Folder::new("other");
        Journal::open(&folder.0, &json!({"device": "d"})).unwrap();
        let error = Journal::open(&folder.0, &json!({"device": "e"})).err().unwrap().to_string();
        assert!(error.contains("device was \"d\", now \"e\""), "{error}");
        std::fs::write(folder.0.join("journal.jsonl"), "{\"device\":\"d\"}\nnonsense\n").unwrap();
        let error = Journal::open(&folder.0, &json!({"device": "d"})).err().unwrap().to_string();
        assert!(error.contains("line 2"), "{error}");
    }
}
