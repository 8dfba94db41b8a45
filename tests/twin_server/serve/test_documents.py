"""The OpenAPI and AsyncAPI documents are served, and are what their specifications ask."""

import pytest
from openapi_spec_validator import OpenAPIV31SpecValidator

from slowtime_schemas import asyncapi


@pytest.fixture(scope="module")
def openapi(server):
    return server.get("/api/v1/openapi.json").json()


def test_the_openapi_document_is_one_by_its_own_schema(openapi):
    assert openapi["openapi"].startswith("3.1")
    assert [str(e)[:300] for e in OpenAPIV31SpecValidator(openapi).iter_errors()] == []


@pytest.mark.long
def test_a_document_with_a_fault_is_no_openapi_document(openapi):
    broken = openapi | {"paths": {"/x": {"get": {"responses": {"200": {"discription": 1}}}}}}
    assert not OpenAPIV31SpecValidator(broken).is_valid()


@pytest.mark.long
def test_the_asyncapi_document_is_served(server):
    answer = server.get("/api/v1/asyncapi.json")
    assert answer.headers["content-type"] == "application/json"
    assert answer.json() == asyncapi.document()
