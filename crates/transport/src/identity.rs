//! Who a server is: its key and certificate on the disk.

use crate::Fingerprint;
use rcgen::{CertificateParams, DistinguishedName, DnType, KeyPair};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::sign::CertifiedKey;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Key and certificate lie in one file, so that there is no moment at which one is there without the other.
const FILE_NAME: &str = "identity.pem";

/// A server's key and self-signed certificate.
#[derive(Clone)]
pub struct Identity {
    key: Arc<CertifiedKey>,
    fingerprint: Fingerprint,
}

/// Why there is no identity.
#[derive(Debug, thiserror::Error)]
pub enum IdentityError {
    /// The directory or the file in it cannot be read or written.
    #[error("cannot {action} {}: {source}", path.display())]
    File {
        /// What was tried.
        action: &'static str,
        /// On which file or directory.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is there but holds no key and certificate that belong together.
    #[error(
        "{} is damaged: {what}; expected a PEM private key and its certificate. Restore it, or remove it to get a \
         new identity, whose fingerprint every headset has to be told",
        path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was found.
        what: String,
    },
    /// No key or certificate could be made.
    #[error("cannot make a key and certificate: {0}")]
    Make(#[from] rcgen::Error),
}

impl Identity {
    /// Reads the identity in `directory`, or makes one there at the first start. The file `identity.pem` holds the
    /// private key and can be read by its owner only. Of several servers that start at once, one makes the file and
    /// the others read it.
    ///
    /// # Errors
    /// If the file is damaged, or it or its directory cannot be read or written. A damaged file is never replaced.
    pub fn load_or_create(directory: &Path) -> Result<Self, IdentityError> {
        let path = directory.join(FILE_NAME);
        if let Some(identity) = Self::load(&path)? {
            return Ok(identity);
        }
        fs::create_dir_all(directory).map_err(file_error("make the directory", directory))?;
        publish(&path, &new_pem()?)?;
        match Self::load(&path)? {
            Some(identity) => Ok(identity),
            None => Err(file_error("read the identity just made in", &path)(io::ErrorKind::NotFound.into())),
        }
    }

    /// Makes an identity that is gone with the process.
    ///
    /// # Errors
    /// If the system gives no randomness.
    pub fn ephemeral() -> Result<Self, IdentityError> {
        Self::from_pem(Path::new("(in memory)"), &new_pem()?)
    }

    /// What clients know this server by.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        self.fingerprint
    }

    pub(crate) fn key(&self) -> Arc<CertifiedKey> {
        self.key.clone()
    }

    /// One that shows `self`'s certificate but holds another key.
    #[cfg(test)]
    pub(crate) fn with_key_of(&self, other: &Self) -> Self {
        let key = CertifiedKey::new(self.key.cert.clone(), other.key.key.clone());
        Self { key: Arc::new(key), fingerprint: self.fingerprint }
    }

    /// `None` if there is no such file.
    fn load(path: &Path) -> Result<Option<Self>, IdentityError> {
        match fs::read_to_string(path) {
            Ok(pem) => {
                warn_if_readable_by_others(path);
                Self::from_pem(path, &pem).map(Some)
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                Err(IdentityError::Damaged { path: path.to_owned(), what: "it is no text".to_owned() })
            }
            Err(source) => Err(file_error("read", path)(source)),
        }
    }

    fn from_pem(path: &Path, pem: &str) -> Result<Self, IdentityError> {
        let damaged = |what: String| IdentityError::Damaged { path: path.to_owned(), what };
        let key = PrivateKeyDer::from_pem_slice(pem.as_bytes())
            .map_err(|error| damaged(format!("private key: {error}")))?;
        let certificate = CertificateDer::from_pem_slice(pem.as_bytes())
            .map_err(|error| damaged(format!("certificate: {error}")))?;
        let fingerprint = Fingerprint::of_certificate(&certificate);
        let key = CertifiedKey::from_der(vec![certificate], key, &rustls::crypto::ring::default_provider())
            .map_err(|error| damaged(error.to_string()))?;
        Ok(Self { key: Arc::new(key), fingerprint })
    }
}

impl std::fmt::Debug for Identity {
    /// Without the key.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Identity({})", self.fingerprint)
    }
}

/// A new key and a certificate that never expires: clients compare it, they do not ask for its date.
fn new_pem() -> Result<String, rcgen::Error> {
    let key = KeyPair::generate()?;
    let mut params = CertificateParams::new(vec!["localhost".to_owned()])?;
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, "holocast");
    params.not_before = rcgen::date_time_ymd(2020, 1, 1);
    // RFC 5280 section 4.1.2.5: the date of a certificate without a well-defined end.
    params.not_after = rcgen::date_time_ymd(9999, 12, 31);
    let certificate = params.self_signed(&key)?;
    Ok(format!("{}{}", certificate.pem(), key.serialize_pem()))
}

/// Gives `path` its content in one step, unless somebody else was faster.
fn publish(path: &Path, pem: &str) -> Result<(), IdentityError> {
    let (temporary, mut file) = create_private(path)?;
    let written = file.write_all(pem.as_bytes()).and_then(|()| file.sync_all());
    let written = written.map_err(file_error("write", &temporary));
    // A link, unlike a rename, does not replace what is there.
    let linked = written.and_then(|()| match fs::hard_link(&temporary, path) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => Err(file_error("write", path)(error)),
        _ => Ok(()),
    });
    // A leftover would hold a key that nobody uses; the error that counts is the one above.
    let _ = fs::remove_file(&temporary);
    linked
}

/// A file beside `path` that nobody else has, and that only its owner can read.
fn create_private(path: &Path) -> Result<(PathBuf, File), IdentityError> {
    let mut options = File::options();
    options.write(true).create_new(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        options.mode(0o600);
    }
    let mut attempt = 0;
    loop {
        let temporary = path.with_extension(format!("{}-{attempt}.part", std::process::id()));
        match options.open(&temporary) {
            Ok(file) => return Ok((temporary, file)),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && attempt < 1000 => attempt += 1,
            Err(error) => return Err(file_error("write", &temporary)(error)),
        }
    }
}

fn warn_if_readable_by_others(path: &Path) {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        if let Ok(metadata) = fs::metadata(path)
            && metadata.permissions().mode() & 0o077 != 0
        {
            tracing::warn!(path = %path.display(), "others can read the server's private key: chmod 600 it");
        }
    }
}

fn file_error(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> IdentityError {
    let path = path.to_owned();
    move |source| IdentityError::File { action, path, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_start_makes_an_identity_and_later_ones_keep_it() {
        let directory = tempfile::tempdir().unwrap();
        let nested = directory.path().join("a/b");
        let first = Identity::load_or_create(&nested).unwrap();
        let second = Identity::load_or_create(&nested).unwrap();
        assert_eq!(first.fingerprint(), second.fingerprint());
        let files: Vec<_> = fs::read_dir(&nested).unwrap().map(|f| f.unwrap().file_name()).collect();
        assert_eq!(files, [FILE_NAME], "nothing else is left behind");
    }

    #[test]
    fn servers_that_start_at_once_agree() {
        let directory = tempfile::tempdir().unwrap();
        let fingerprints: Vec<_> = std::thread::scope(|scope| {
            let starts: Vec<_> = (0..8)
                .map(|_| scope.spawn(|| Identity::load_or_create(directory.path()).unwrap().fingerprint()))
                .collect();
            starts.into_iter().map(|start| start.join().unwrap()).collect()
        });
        assert!(fingerprints.iter().all(|fingerprint| *fingerprint == fingerprints[0]));
    }

    #[cfg(unix)]
    #[test]
    fn only_its_owner_can_read_the_key() {
        use std::os::unix::fs::PermissionsExt;
        let directory = tempfile::tempdir().unwrap();
        Identity::load_or_create(directory.path()).unwrap();
        let mode = fs::metadata(directory.path().join(FILE_NAME)).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }

    #[test]
    fn a_damaged_file_is_named_and_kept() {
        let check = |spoil: &dyn Fn(&str) -> Vec<u8>, needle: &str| {
            let directory = tempfile::tempdir().unwrap();
            let path = directory.path().join(FILE_NAME);
            fs::write(&path, spoil(&new_pem().unwrap())).unwrap();
            let before = fs::read(&path).unwrap();
            let error = Identity::load_or_create(directory.path()).unwrap_err();
            assert!(matches!(error, IdentityError::Damaged { .. }), "{error:?}");
            let text = error.to_string();
            assert!(text.contains(path.to_str().unwrap()) && text.contains(needle), "{text}");
            assert_eq!(fs::read(&path).unwrap(), before);
        };
        check(&|_| Vec::new(), "private key");
        check(&|_| vec![0xff; 64], "no text");
        check(&|pem| pem[pem.find("-----BEGIN PRIVATE").unwrap()..].into(), "certificate");
        check(&|pem| pem[..pem.find("-----BEGIN PRIVATE").unwrap()].into(), "private key");
        check(&|pem| pem[..pem.len() - 60].into(), "private key");
        // A certificate of another key.
        check(
            &|pem| {
                let others = new_pem().unwrap();
                let key = pem.find("-----BEGIN PRIVATE").unwrap();
                let others_key = others.find("-----BEGIN PRIVATE").unwrap();
                format!("{}{}", &others[..others_key], &pem[key..]).into_bytes()
            },
            "keys",
        );
    }

    #[test]
    fn a_directory_that_is_none_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("file");
        fs::write(&file, "").unwrap();
        let error = Identity::load_or_create(&file).unwrap_err();
        assert!(error.to_string().contains(file.to_str().unwrap()), "{error}");
    }
}
