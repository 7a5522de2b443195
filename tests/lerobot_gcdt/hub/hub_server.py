"""A Hugging Face Hub in memory, on 127.0.0.1: as much of its HTTP API as LeRobot and ``gcdt publish`` use.

After ``huggingface_hub.set_client_factory(server.client)``, the real client talks to such a server only.
"""

import base64
import hashlib
import json
import re
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock, Thread

import httpx
from huggingface_hub.utils._http import hf_request_event_hook

USER, TOKEN = "me", "hf_of_me"


@dataclass
class Repo:
    """A repository: the files of each commit by their path, and where branches and tags point to."""

    private: bool
    commits: dict[str, dict[str, bytes]] = field(default_factory=dict)
    branches: dict[str, str] = field(default_factory=dict)
    tags: dict[str, str] = field(default_factory=dict)

    def __post_init__(self):
        self.commit("main", {})

    def commit(self, branch: str, files: dict[str, bytes]) -> str:
        commit = hashlib.sha1(f"commit {len(self.commits)}".encode()).hexdigest()
        self.commits[commit], self.branches[branch] = files, commit
        return commit

    def resolve(self, revision: str) -> str | None:
        commit = self.branches.get(revision) or self.tags.get(revision) or revision
        return commit if commit in self.commits else None

    def files(self, revision: str = "main") -> dict[str, bytes]:
        return self.commits[self.resolve(revision)]


class Refusal(Exception):
    """Ends a request with a status other than 200, and with the Hub's name of the error."""

    def __init__(self, status: int, message: str, code: str = "", **more):
        super().__init__(message)
        self.status, self.code, self.body = status, code, {"error": message, **more}


class HubServer(ThreadingHTTPServer):
    """Serves from a thread of its own until ``shutdown``.

    Attributes:
        repos: The repositories by kind (``"models"`` or ``"datasets"``) and id.
        requests: Method and path of every request so far.
        refuse: A status that commits are answered with, such as 507; 0 accepts them.
        complaint: What is wrong with cards; nothing if empty.
    """

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), _Request)
        self.repos: dict[tuple[str, str], Repo] = {}
        self.requests: list[tuple[str, str]] = []
        self.refuse, self.complaint = 0, ""
        self.lock = Lock()
        Thread(target=self.serve_forever, daemon=True).start()

    def client(self) -> httpx.Client:
        """A client that sends every request here, whatever host it names: some of the Hub's are hard-coded."""
        return client(self.server_port)


class _ToServer(httpx.HTTPTransport):
    def __init__(self, port: int):
        super().__init__()
        self.port = port

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        request.url = request.url.copy_with(scheme="http", host="127.0.0.1", port=self.port)
        return super().handle_request(request)


def client(port: int) -> httpx.Client:
    """Makes the client of a server that may run in another process."""
    hooks = {"request": [hf_request_event_hook]}  # as in the client's own factory; this one obeys HF_HUB_OFFLINE
    return httpx.Client(transport=_ToServer(port), event_hooks=hooks, follow_redirects=True, timeout=30)


def git_sha(content: bytes) -> str:
    """The id that git gives to a file."""
    return hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()


class _Request(BaseHTTPRequestHandler):
    server: HubServer
    protocol_version = "HTTP/1.1"

    def do_GET(self):
        self.content = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        path = self.path.split("?")[0]
        self.server.requests.append((self.command, path))
        method = "GET" if self.command == "HEAD" else self.command
        try:
            with self.server.lock:
                self._check_token()
                for (wanted, pattern), handle in ROUTES.items():
                    match = re.fullmatch(pattern, path)
                    if wanted == method and match:
                        return self._reply(200, *_with_headers(handle(self, *match.groups())))
                raise Refusal(404, f"The test's server has no {self.command} {path}.")
        except Refusal as refusal:
            headers = {"X-Error-Code": refusal.code, "X-Error-Message": str(refusal)}
            self._reply(refusal.status, json.dumps(refusal.body).encode(), headers)

    do_HEAD = do_POST = do_DELETE = do_GET

    def log_message(self, *_):
        pass

    def _reply(self, status: int, content: bytes, headers: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in {"Content-Length": str(len(content)), **headers}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def _check_token(self) -> None:
        self.known = self.headers.get("Authorization") == f"Bearer {TOKEN}"
        if not self.known and "Authorization" in self.headers:
            raise Refusal(401, "Invalid credentials in Authorization header")
        if not self.known and self.command in ("POST", "DELETE") and self.path != VALIDATE:
            raise Refusal(401, "Access requires a token")

    def _repo(self, kind: str, name: str) -> Repo:
        repo = self.server.repos.get((kind or "models", name))
        if repo is None or (repo.private and not self.known):
            raise Refusal(404 if self.known else 401, "Repository not found", "RepoNotFound")
        return repo

    def _commit(self, repo: Repo, revision: str) -> str:
        commit = repo.resolve(revision.replace("%2F", "/"))
        if commit is None:
            raise Refusal(404, f"Invalid rev id: {revision}", "RevisionNotFound")
        return commit

    def whoami(self):
        if not self.known:
            raise Refusal(401, "Invalid user token.")
        return {"type": "user", "name": USER, "orgs": [], "auth": {"accessToken": {"role": "write"}}}

    def create(self):
        wanted = json.loads(self.content)
        kind, name = f"{wanted.get('type', 'model')}s", f"{wanted.get('organization', USER)}/{wanted['name']}"
        url = f"https://huggingface.co/{'datasets/' if kind == 'datasets' else ''}{name}"
        if not name.startswith(f"{USER}/"):
            raise Refusal(403, "You don't have the rights to create a repository under this namespace")
        if (kind, name) in self.server.repos:
            raise Refusal(409, "You already created this repository", url=url)
        self.server.repos[kind, name] = Repo(wanted.get("visibility") == "private")
        return {"url": url, "name": name}

    def validate(self):
        if self.server.complaint:
            raise Refusal(400, "", errors=[{"message": self.server.complaint}], warnings=[])
        return {"errors": [], "warnings": []}

    def info(self, kind: str, name: str, revision: str = "main"):
        repo = self._repo(kind, name)
        commit = self._commit(repo, revision)
        siblings = [{"rfilename": path} for path in repo.commits[commit]]
        return {"id": name, "private": repo.private, "sha": commit, "siblings": siblings, "tags": []}

    def refs(self, kind: str, name: str):
        repo = self._repo(kind, name)

        def listed(where: str, refs: dict[str, str]):
            return [{"name": n, "ref": f"refs/{where}/{n}", "targetCommit": c} for n, c in refs.items()]

        return {"branches": listed("heads", repo.branches), "tags": listed("tags", repo.tags), "converts": []}

    def tree(self, kind: str, name: str, revision: str):
        files = self._repo(kind, name).files(revision)
        return [{"type": "file", "path": p, "size": len(c), "oid": git_sha(c)} for p, c in files.items()]

    def preupload(self, kind: str, name: str, revision: str):
        files = self._repo(kind, name).files(revision)
        return {
            "files": [
                {
                    "path": path,
                    "uploadMode": "regular",
                    "shouldIgnore": False,
                    "oid": git_sha(files[path]) if path in files else None,
                }
                for path in (file["path"] for file in json.loads(self.content)["files"])
            ]
        }

    def commit(self, kind: str, name: str, branch: str):
        repo = self._repo(kind, name)
        if self.server.refuse:
            raise Refusal(self.server.refuse, "The server does not take this commit.")
        files = dict(repo.files(branch))
        for line in self.content.splitlines():
            operation = json.loads(line)
            value = operation["value"]
            if operation["key"] == "file":
                files[value["path"]] = base64.b64decode(value["content"])
            elif operation["key"] == "deletedFile":
                del files[value["path"]]
        commit = repo.commit(branch, files)
        prefix = "datasets/" if kind == "datasets" else ""
        return {"commitUrl": f"https://huggingface.co/{prefix}{name}/commit/{commit}", "commitOid": commit}

    def branch(self, kind: str, name: str, branch: str):
        repo = self._repo(kind, name)
        repo.branches.setdefault(branch, repo.branches["main"])
        return {}

    def tag(self, kind: str, name: str, revision: str):
        repo, tag = self._repo(kind, name), json.loads(self.content)["tag"]
        if tag in repo.tags:
            raise Refusal(409, f"Tag {tag} already exists")
        repo.tags[tag] = self._commit(repo, revision)
        return {}

    def delete_tag(self, kind: str, name: str, tag: str):
        if self._repo(kind, name).tags.pop(tag, None) is None:
            raise Refusal(404, f"Invalid rev id: {tag}", "RevisionNotFound")
        return {}

    def resolve(self, prefix: str | None, name: str, revision: str, path: str):
        repo = self._repo((prefix or "models/").strip("/"), name)
        commit = self._commit(repo, revision)
        content = repo.commits[commit].get(path.replace("%2F", "/"))
        if content is None:
            raise Refusal(404, f"{path} is not in {name}", "EntryNotFound")
        return content, {"ETag": f'"{git_sha(content)}"', "X-Repo-Commit": commit}


def _with_headers(answer) -> tuple[bytes, dict[str, str]]:
    if isinstance(answer, tuple):
        return answer
    return json.dumps(answer).encode(), {"Content-Type": "application/json"}


VALIDATE = "/api/validate-yaml"  # open to everybody
REPO = "/api/(models|datasets)/([^/]+/[^/]+)"
ROUTES = {
    ("GET", "/api/whoami-v2"): _Request.whoami,
    ("POST", "/api/repos/create"): _Request.create,
    ("POST", VALIDATE): _Request.validate,
    ("GET", REPO): _Request.info,
    ("GET", f"{REPO}/revision/([^/]+)"): _Request.info,
    ("GET", f"{REPO}/refs"): _Request.refs,
    ("GET", f"{REPO}/tree/([^/]+)"): _Request.tree,
    ("POST", f"{REPO}/preupload/([^/]+)"): _Request.preupload,
    ("POST", f"{REPO}/commit/([^/]+)"): _Request.commit,
    ("POST", f"{REPO}/branch/([^/]+)"): _Request.branch,
    ("POST", f"{REPO}/tag/([^/]+)"): _Request.tag,
    ("DELETE", f"{REPO}/tag/([^/]+)"): _Request.delete_tag,
    ("GET", "/(datasets/)?([^/]+/[^/]+)/resolve/([^/]+)/(.+)"): _Request.resolve,
}
