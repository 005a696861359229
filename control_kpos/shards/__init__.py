"""Networks in shards on files, larger than memory: written, certified and checked one shard at a time."""

from .certificate import ShardedCertificate, check
from .certifying import certify
from .tables import parquet
from .writing import write

__all__ = ["ShardedCertificate", "certify", "check", "parquet", "write"]
