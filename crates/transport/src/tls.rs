//! TLS 1.3 with one certificate that is pinned by its hash, and nothing else.

use crate::{Fingerprint, Identity};
use quinn::crypto::rustls::{NoInitialCipherSuite, QuicClientConfig, QuicServerConfig};
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::{CryptoProvider, WebPkiSupportedAlgorithms, ring, verify_tls13_signature};
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::server::{ClientHello, ResolvesServerCert};
use rustls::sign::CertifiedKey;
use rustls::version::TLS13;
use rustls::{
    CertificateError, DigitallySignedStruct, OtherError, PeerIncompatible, PeerMisbehaved, SignatureScheme,
};
use std::sync::{Arc, OnceLock};

/// What TLS cannot do here. The settings are our own, so it comes of a broken build rather than of a peer.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// The provider lacks what is asked of it.
    #[error(transparent)]
    Rustls(#[from] rustls::Error),
    /// The provider lacks the cipher that QUIC begins with.
    #[error(transparent)]
    Cipher(#[from] NoInitialCipherSuite),
}

/// A server that shows its one certificate to whoever asks, and speaks one of `protocols`.
pub(crate) fn server_config(
    identity: &Identity,
    protocols: &[&[u8]],
) -> Result<Arc<QuicServerConfig>, TlsError> {
    let mut config = rustls::ServerConfig::builder_with_provider(provider())
        .with_protocol_versions(&[&TLS13])?
        .with_no_client_auth()
        .with_cert_resolver(Arc::new(OneCertificate(identity.key())));
    config.alpn_protocols = owned(protocols);
    Ok(Arc::new(QuicServerConfig::try_from(config)?))
}

/// A client that takes the certificate with the pinned hash. Another one that was found instead is put into `found`.
pub(crate) fn client_config(
    pinned: Fingerprint,
    protocols: &[&[u8]],
    found: Arc<OnceLock<Fingerprint>>,
) -> Result<Arc<QuicClientConfig>, TlsError> {
    let provider = provider();
    let verifier = PinnedVerifier { pinned, found, algorithms: provider.signature_verification_algorithms };
    let mut config = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&TLS13])?
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(verifier))
        .with_no_client_auth();
    config.alpn_protocols = owned(protocols);
    Ok(Arc::new(QuicClientConfig::try_from(config)?))
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

fn owned(protocols: &[&[u8]]) -> Vec<Vec<u8>> {
    protocols.iter().map(|protocol| protocol.to_vec()).collect()
}

#[derive(Debug)]
struct OneCertificate(Arc<CertifiedKey>);

impl ResolvesServerCert for OneCertificate {
    fn resolve(&self, _hello: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        Some(self.0.clone())
    }
}

/// Trusts one certificate: no name, no date and no authority is asked for, but that the server holds its key is.
#[derive(Debug)]
struct PinnedVerifier {
    pinned: Fingerprint,
    found: Arc<OnceLock<Fingerprint>>,
    algorithms: WebPkiSupportedAlgorithms,
}

#[derive(Debug, thiserror::Error)]
#[error("certificate has fingerprint {found}, expected {expected}")]
struct WrongCertificate {
    expected: Fingerprint,
    found: Fingerprint,
}

impl ServerCertVerifier for PinnedVerifier {
    fn verify_server_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        _intermediates: &[CertificateDer<'_>],
        _server_name: &ServerName<'_>,
        _ocsp_response: &[u8],
        _now: UnixTime,
    ) -> Result<ServerCertVerified, rustls::Error> {
        let found = Fingerprint::of_certificate(end_entity);
        if found == self.pinned {
            return Ok(ServerCertVerified::assertion());
        }
        // One connection has one handshake; a second value could only be the same.
        let _ = self.found.set(found);
        let wrong = WrongCertificate { expected: self.pinned, found };
        Err(CertificateError::Other(OtherError(Arc::new(wrong))).into())
    }

    fn verify_tls12_signature(
        &self,
        _message: &[u8],
        _certificate: &CertificateDer<'_>,
        _signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        Err(PeerIncompatible::ServerDoesNotSupportTls12Or13.into())
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        if Fingerprint::of_certificate(certificate) != self.pinned {
            return Err(PeerMisbehaved::SignedHandshakeWithUnadvertisedSigScheme.into());
        }
        verify_tls13_signature(message, certificate, signature, &self.algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.algorithms.supported_schemes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ConnectError, ServerEndpoint, TransportSettings, connect};

    #[tokio::test]
    async fn a_certificate_without_its_key_is_worth_nothing() {
        let (server, thief) = (Identity::ephemeral().unwrap(), Identity::ephemeral().unwrap());
        let settings = TransportSettings::default();
        let check = async |identity: &Identity| {
            let endpoint =
                ServerEndpoint::bind(([127, 0, 0, 1], 0).into(), identity, &[b"test/1"], &settings).unwrap();
            let address = endpoint.local_addr().unwrap().to_string();
            connect(&address, server.fingerprint(), b"test/1", &settings).await
        };
        check(&server).await.unwrap();
        // The fingerprint is right, the signature is not.
        let error = check(&server.with_key_of(&thief)).await.unwrap_err();
        assert!(matches!(error, ConnectError::Handshake { .. }), "{error:?}");
        assert!(error.to_string().contains("BadSignature"), "{error}");
    }
}
